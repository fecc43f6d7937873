"""Eight logs as the data logger of another car writes them, for the tutorial on logs.

python examples/own_logs/make_logs.py logs

A battery-electric car that is 250 kg heavier, with a faster steering gear and a weaker pedal than
the shipped ones, is driven with random speeds and turns of the steering wheel, four minutes a log.
Logged at 50 Hz: what is on the bus of such a car, and what an inertial navigation system at its
centre of gravity measures. There is no lateral speed.
"""

import sys
from math import cos, degrees, radians, sin
from pathlib import Path

import numpy as np

from rt_controller import ControlInput
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.plant.parameters import load_parameters, with_mass_factor

LOGS, DURATION_S, PERIOD_S = 8, 240.0, 0.02
COLUMNS = {  # and how they are written, and the standard deviation of the noise
    "Time [s]": ("%.3f", 0.0),
    "Speed [km/h]": ("%.2f", 0.05),
    "Yaw rate [deg/s]": ("%.3f", 0.05),
    "Steering wheel [deg]": ("%.2f", 0.1),
    "Accelerator [%]": ("%.2f", 0.0),
    "Brake force [N]": ("%.2f", 0.0),
    "Longitude [deg]": ("%.8f", 2e-7),
    "Latitude [deg]": ("%.8f", 2e-7),
    "Heading [deg]": ("%.3f", 0.1),
}
HOME_DEG = (11.57, 48.14)
METRES_PER_DEG = (111_320.0 * cos(radians(HOME_DEG[1])), 111_200.0)


def foreign_car() -> OwnCar:
    car = with_mass_factor(load_parameters("c_class_150kw_bev"), 1.14)
    steering = car.steering._replace(ratio=0.9 * car.steering.ratio)
    torques_nm = tuple(map(tuple, 0.8 * np.array(car.motor.map_nm)))
    return OwnCar(car._replace(steering=steering, motor=car.motor._replace(map_nm=torques_nm)))


class Driver:
    """Holds a speed for some seconds, the wheel for one to three, and the pedals for one."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.wanted_mps = rng.uniform(10.0, 32.0)
        self.wanted_rad = 0.0
        self.missing_mps = 0.0
        self.speed_until_s = self.wheel_until_s = self.pedals_until_s = 0.0
        self.control = ControlInput(0.0, 0.0, 0.0)

    def drive(self, time_s: float, speed_mps: float) -> ControlInput:
        rng = self.rng
        if time_s >= self.speed_until_s:
            self.wanted_mps = rng.uniform(6.0, 32.0)
            self.speed_until_s = time_s + rng.uniform(5.0, 15.0)
        if time_s >= self.wheel_until_s:
            largest_rad = min(2.5, 380.0 / max(speed_mps, 6.0) ** 2)  # about 7 m/s^2
            self.wanted_rad = rng.uniform(-largest_rad, largest_rad)
            self.wheel_until_s = time_s + rng.uniform(0.5, 3.0)
        if time_s >= self.pedals_until_s:
            self.missing_mps = self.wanted_mps - speed_mps
            self.pedals_until_s = time_s + 1.0
        throttle = min(max(0.1 + 0.06 * self.missing_mps, 0.0), 0.7)
        brake_n = min(max(-18.0 * (self.missing_mps + 1.0), 0.0), 120.0)
        last = self.control  # one foot: each pedal waits for the other
        self.control = ControlInput(
            approach(last.throttle, throttle if brake_n == last.brake_n == 0.0 else 0.0, 2.0),
            approach(last.brake_n, brake_n if last.throttle == 0.0 else 0.0, 300.0),
            approach(last.steer_rad, self.wanted_rad, 2.5),
        )
        return self.control


def approach(now: float, wanted: float, rate_per_s: float) -> float:
    step = rate_per_s * PERIOD_S
    return now + min(max(wanted - now, -step), step)


def drive(seed: int) -> np.ndarray:
    """One log, a row for each sample, without noise."""
    rng = np.random.default_rng(seed)
    car, driver = foreign_car(), Driver(rng)
    vx, vy, yaw_rate = car.reset(rng.uniform(12.0, 25.0))
    east_m = north_m = yaw_rad = 0.0
    rows = []
    for k in range(round(DURATION_S / PERIOD_S)):
        control = driver.drive(k * PERIOD_S, vx)
        heading_deg = (90.0 - degrees(yaw_rad)) % 360.0
        place_deg = np.add(HOME_DEG, np.divide((east_m, north_m), METRES_PER_DEG))
        motion_deg = degrees(yaw_rate), degrees(control.steer_rad)
        pedals = 100.0 * control.throttle, control.brake_n
        rows.append((k * PERIOD_S, 3.6 * vx, *motion_deg, *pedals, *place_deg, heading_deg))
        motion = car.step(control, PERIOD_S)
        for vx, vy, yaw_rate in motion.tolist():
            dt_s = PERIOD_S / len(motion)
            yaw_rad += dt_s * yaw_rate
            east_m += dt_s * (vx * cos(yaw_rad) - vy * sin(yaw_rad))
            north_m += dt_s * (vx * sin(yaw_rad) + vy * cos(yaw_rad))
    return np.array(rows)


folder = Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
formats, noise = zip(*COLUMNS.values(), strict=True)
for number in range(1, LOGS + 1):
    rows = drive(number)
    rows += np.random.default_rng(100 + number).normal(size=rows.shape) * noise
    head = ",".join(COLUMNS)
    path = folder / f"drive_{number}.csv"
    np.savetxt(path, rows, formats, delimiter=",", header=head, comments="", encoding="utf-8")
    print(path)
