"""Real-time vehicle control with a Koopman model that is learned from data: the public names.

    simulate            drive a scenario with a simulated car; returns a Drive
    compare             drive scenarios with several controllers; returns a Comparison
    Drive               a finished drive as a table with units, errors and a plot
    Controller          model predictive control without a bus: state and path in, Plan out
    Plan                inputs over the horizon and the predicted states
    ControlLaw, Observation
                        a controller of one's own in the place of the MPC, and what it receives
    ControllerConfig    settings of a controller
    MpcSettings         those of its optimal control problem
    Bundle              a model: load a shipped or trained one, or make one of matrices
    VehicleState, PathReference, CurvaturePreview, ControlInput
                        what a controller receives and returns
    fit_preview         a CurvaturePreview from the curvature of a map
    RtControllerError   base of the errors that this package raises

Each is imported when it is first used, so that `import rt_controller` costs nothing.
"""

from typing import TYPE_CHECKING

from rt_controller.public_names import public_names

if TYPE_CHECKING:
    from rt_controller.comparison import compare as compare
    from rt_controller.config import ControllerConfig as ControllerConfig
    from rt_controller.config import MpcSettings as MpcSettings
    from rt_controller.contract.errors import RtControllerError as RtControllerError
    from rt_controller.contract.preview import fit_preview as fit_preview
    from rt_controller.contract.signals import ControlInput as ControlInput
    from rt_controller.contract.signals import CurvaturePreview as CurvaturePreview
    from rt_controller.contract.signals import PathReference as PathReference
    from rt_controller.contract.signals import VehicleState as VehicleState
    from rt_controller.control.law import ControlLaw as ControlLaw
    from rt_controller.control.law import Observation as Observation
    from rt_controller.controller import Controller as Controller
    from rt_controller.controller import Plan as Plan
    from rt_controller.drive.table import Drive as Drive
    from rt_controller.model.bundle import Bundle as Bundle
    from rt_controller.simulation import simulate as simulate

__all__, __getattr__, __dir__ = public_names(
    __name__,
    {
        "Bundle": "model.bundle",
        "ControlInput": "contract.signals",
        "ControlLaw": "control.law",
        "Controller": "controller",
        "ControllerConfig": "config",
        "CurvaturePreview": "contract.signals",
        "Drive": "drive.table",
        "MpcSettings": "config",
        "Observation": "control.law",
        "PathReference": "contract.signals",
        "Plan": "controller",
        "RtControllerError": "contract.errors",
        "VehicleState": "contract.signals",
        "compare": "comparison",
        "fit_preview": "contract.preview",
        "simulate": "simulation",
    },
)
