"""Who goes first where controller and car share a machine."""

FIFO_PRIORITY = 40
"""of the car's thread, below the controller's"""
