"""How far the car turns for an angle of its wheel, beside the car of the model."""

from math import inf

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.roll_outs import STEPS

SMALLEST, LARGEST = 0.7, 1.4
"""bounds of the factor, whatever is measured"""
INFORMATION = 0.018
"""divided by the gain of the disturbance: sum of squares of the yaw rate, in (rad/s)^2, after which
two thirds of an error are corrected"""
LEAST_RADPS = 0.02
"""smallest yaw rate, less its average, from which the factor is learned: noise of the sensor is not
in the prediction, so a factor that is learned from noise grows to its bound"""
AVERAGED = 0.02
"""share of one period in the averages: those of about a second"""
AT_RATE_RAD = 0.95 * INPUT_LIMITS.rate_per_s.steer_rad * PERIOD_S
"""change of the wheel in one period from which it is at its largest rate"""


def information(gain: float) -> float:
    """As `INFORMATION`, for a gain of the disturbance. A model that needs a small gain, such as a
    linear one, is wrong in more than this factor, and learns it as slowly."""
    return INFORMATION / gain if gain > 0.0 else inf


class SteeringFactor:
    """The gain from the wheel to the yaw rate, relative to that of the model.

    Steering ratio, tyres, load and friction change this gain, which a disturbance that is added to
    the states cannot represent. The model gets `value` times the angle of the wheel, and the wheel
    turns by the planned angle over `value`.

    The yaw rate that was predicted for now ten periods ago, with the wheel that was applied since
    then, is compared with the measured one, each less its average: that contains what does not
    change with the wheel, as a bank or an offset of a sensor. The prediction is explained by the
    measurement and not the other way round: where the wheel only compensates a side wind, the
    measured yaw rate is zero, and nothing is learned. Method: normalised least mean squares (Widrow
    and Hoff, 1960).
    """

    def __init__(self, gain: float, learns_at_rate: bool = False) -> None:
        """For a gain of the disturbance, as of `Estimator`; 0: the factor stays 1.

        In drives, the factor of a learned model was worse than none after the wheel had turned at
        its largest rate; for a single-track model it was needed there: `learns_at_rate`.
        """
        self._information = information(gain)
        self._at_rate_rad = inf if learns_at_rate else AT_RATE_RAD
        self.reset()

    def reset(self) -> None:
        """The car is that of the model until something else is measured."""
        self.value = 1.0
        self._predicted = self._measured = 0.0
        """averages, in rad/s; of the prediction with a factor of 1"""
        self._share = 1.0
        """of the next yaw rate in them: first they are the mean of all"""
        self._steer_rad = 0.0
        self._periods_left = 0
        """until the wheel was not at its rate in the prediction that is learned from"""

    def of_model(self, control: ControlInput) -> ControlInput:
        """The input with which the car of the model moves as this car does with `control`."""
        return control._replace(steer_rad=self.value * control.steer_rad)

    def turn(self, steer_rad: float) -> None:
        """The angle of the wheel in the next period."""
        is_at_rate = abs(steer_rad - self._steer_rad) >= self._at_rate_rad
        self._periods_left = STEPS if is_at_rate else max(self._periods_left - 1, 0)
        self._steer_rad = steer_rad

    def learn(self, predicted_radps: float, measured_radps: float) -> None:
        """Learn from the yaw rate of now, and from that which was predicted with `value`."""
        of_one_radps = predicted_radps / self.value
        self._predicted += self._share * (of_one_radps - self._predicted)
        self._measured += self._share * (measured_radps - self._measured)
        self._share = max(self._share / (1.0 + self._share), AVERAGED)
        predicted, measured = of_one_radps - self._predicted, measured_radps - self._measured
        if abs(measured) < LEAST_RADPS or self._periods_left > 0:
            return
        inverse = 1.0 / self.value
        error = predicted - inverse * measured
        inverse += measured * error / (self._information + measured**2)
        self.value = 1.0 / min(max(inverse, 1.0 / LARGEST), 1.0 / SMALLEST)
