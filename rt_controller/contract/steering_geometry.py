"""Geometry of the car that steering without a learned model needs: the single-track model."""

from typing import NamedTuple


class SteeringGeometry(NamedTuple):
    """A car that rolls without sideslip of its tyres, as it does at walking pace."""

    wheelbase_m: float
    """front axle to rear axle"""
    rear_axle_m: float
    """centre of gravity to rear axle"""
    steering_ratio: float
    """angle of the steering wheel over the angle of the front wheels"""


SMALLEST = SteeringGeometry(wheelbase_m=0.5, rear_axle_m=0.0, steering_ratio=1.0)
LARGEST = SteeringGeometry(wheelbase_m=10.0, rear_axle_m=10.0, steering_ratio=100.0)
"""limits of a road vehicle, 1:1 models included"""

DEFAULT_GEOMETRY = SteeringGeometry(wheelbase_m=2.910, rear_axle_m=1.8604, steering_ratio=18.5)
"""of the default car (`sim_bridge/cars/c_class_150kw_awd.toml`), for models of an unnamed car"""
