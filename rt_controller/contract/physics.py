"""Physical constants."""

GRAVITY_MPS2 = 9.80665
"""standard gravity"""
