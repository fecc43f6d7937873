"""Limits of what a scenario may ask for, and conversions of its units."""

KMH_PER_MPS = 3.6
FASTEST_KMH = 250.0
SLOWEST_KMH = 0.36
"""of a wanted speed that is not 0: below it a car counts as standing"""
LARGEST_CURVATURE_PER_M = 0.15
"""limited by the value range of the frames"""
SMALLEST_RADIUS_M = 6.7
LARGEST_EY_M = 10.0
LARGEST_START_EY_M, LARGEST_START_EPSI_DEG = 5.0, 30.0
STEEPEST_BANK_DEG = 12.0
STEEPEST_PERCENT = 20.0
STRONGEST_WIND_MPS = 40.0
LONGEST_S = 3600.0
LONGEST_ROAD_M = LONGEST_S * FASTEST_KMH / KMH_PER_MPS
DRY_ASPHALT = 0.85
"""friction of a road that names none"""
