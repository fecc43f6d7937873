"""The configuration of a training run, and its presets.

Imports neither numpy nor torch, so that command lines load quickly.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, PositiveInt

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.follow import Follow
from rt_controller.settings_table import Settings

TRAJECTORY_S = 2.0
"""the paper's horizon"""
LONGEST_PAST_S = 0.5
"""kept before each trajectory: the longest history that a model may use"""
STEPS = round(TRAJECTORY_S / PERIOD_S)
PAST_STEPS = round(LONGEST_PAST_S / PERIOD_S)

Weight = Annotated[float, Field(ge=0.0)]
LargestSteer = Annotated[float, Field(ge=40.0, le=300.0)]
"""in deg, from the bound of the controller at every speed to the largest one"""


class TrainingConfig(Settings):
    """All settings of a training run; the defaults are the preset `recommended`.

    An epoch of the paper is one mini-batch step here. The forgetting factor gamma of the paper's
    table is the beta of its eq. (10).
    """

    preset: str = "recommended"
    """starting point: recommended, small, linear, paper, paper-literal or quick"""

    init: str | None = None
    """bundle whose weights, structure and scaling the training begins with, a shipped name or a
    folder; none: random weights"""
    steps: PositiveInt = 10_000
    """mini-batch steps"""
    batch: PositiveInt = 256
    """trajectories in a mini-batch"""
    seed: int = 0
    """seed of the initial weights and of the batches"""
    threads: PositiveInt = 1
    """CPU threads of torch; for these small batches a second one saves no time"""
    device: str = "cpu"
    """torch device: cpu, cuda, cuda:1, …"""

    windows: Literal["all", "slices"] = "all"
    """train on any window of any episode, each on a random road if it has poses, or on the paper's
    slices"""
    near_roads: float = Field(default=0.5, ge=0.0, le=1.0)
    """share of those windows whose road has about the curvature of the car's own turn, up to a
    radius of 6.7 m; the others have a road of the data set's curvatures"""
    rare_share: float = Field(default=0.5, ge=0.0, lt=1.0)
    """share of the draws that prefers windows with rare motion, which weights in the loss
    compensate for; without effect on windows slices and objective paper"""
    symmetry: Literal["exact", "trained", "none"] = "exact"
    """of left and right, if the data set says which signals change sign. exact: a model of even and
    odd observables; trained: left and right are exchanged in half of the trajectories"""

    noise: float = Field(default=1.0, ge=0.0, le=10.0)
    """largest level of the measurement noise on the first state and the past of a trajectory, in
    units of the noise of production sensors; each trajectory has a level between 0 and this"""

    optimizer: Literal["muon", "adam"] = "muon"
    """muon: Muon for the matrices but A, Adam for the rest; adam: Adam for all"""
    learning_rate: PositiveFloat = 2e-3
    """initial rate of Adam, or the highest of the cosine schedule"""
    matrix_rate: float = Field(default=2.0, gt=0.0)
    """learning rate of Muon relative to that of Adam"""
    operator_rate: float = Field(default=0.2, gt=0.0)
    """learning rate of A as a share of the others: over 80 steps a small change of A changes the
    prediction much"""
    rate_schedule: Literal["cosine", "plateau"] = "cosine"
    """cosine: warm up over 5 % of the steps, then fall to zero as half a cosine; plateau: halve
    when the validation loss stalls"""
    patience: PositiveInt = 3
    """evaluations without improvement until the plateau schedule halves the rate"""
    evaluate_every: PositiveInt = 500
    """steps between two evaluations"""
    gradient_clip: PositiveFloat | None = 5.0
    """largest norm of the gradient; none: no limit"""
    best_rule: Literal["global-minimum", "as-printed"] = "global-minimum"
    """keep the model of the lowest validation loss, or Algorithm 1 as printed"""

    objective: Literal["horizon", "paper"] = "horizon"
    """horizon: log error of the physical states over the horizon; paper: eqs. (9) and (10)"""
    horizon_start: PositiveInt | None = Field(default=8, le=STEPS)
    """steps of the first roll-outs of the objective horizon; none: all steps"""
    horizon_growth: float = Field(default=0.3, gt=0.0, le=1.0)
    """share of the training after which roll-outs have all steps"""
    forgetting: float = Field(default=0.9, gt=0.0, le=1.0)
    """beta of eq. (10)"""
    weight_single_step: Weight = 0.0
    """alpha_1 of eq. (13)"""
    weight_multi_step: Weight = 1.0
    """alpha_2 of eq. (13)"""
    weight_stability: Weight = 50.0
    """alpha_3 of eq. (13)"""
    weight_regularisation: Weight = 1e-4
    """alpha_4 of eq. (13)"""
    decay_encoder: Weight = 0.9
    """lambda_theta of eq. (12)"""
    decay_operator: Weight = 0.0
    """lambda_K of eq. (12)"""
    operator_prior: Literal["identity", "zero"] = "identity"
    """initial value of A, from which eq. (12) measures it; zero as printed"""
    stability: Literal["driven", "gelfand", "eigenvalue"] = "driven"
    """driven: penalty on growth and spectral radius under all inputs within their bounds; gelfand:
    on the growth of A^64 alone; eigenvalue: eq. (11) as printed"""
    through_last_step: bool = True
    """sum eq. (10) up to step K instead of the printed K-1"""

    activation: Literal["silu", "relu"] = "silu"
    """activation of the hidden layers of the encoder"""
    hidden: tuple[PositiveInt, ...] = (128, 128)
    """widths of the encoder's hidden layers"""
    latents: PositiveInt = 40
    """P, number of observables besides the physical states"""
    latents_start: Literal["fading", "identity"] = "fading"
    """initial latents: fading: small, with time constants from 0.05 to 5 s in A; identity:
    persistent"""
    constant_observable: bool = True
    """one of the latents is the constant 1, which replaces a bias"""
    lift_exogenous: bool = True
    """the encoder reads the exogenous signals (curvature)"""
    products: bool = True
    """the encoder adds a linear layer of all products of two states and, if it reads them,
    exogenous signals"""
    history_steps: int = Field(default=20, ge=0, le=PAST_STEPS)
    """past periods that the encoder reads"""
    separate_motion: bool = True
    """the observables are those of the motion, and progress and place on the road follow from it by
    kinematics; without effect on signals that are not those of a car on a road"""
    bilinear_rank: int = Field(default=10, ge=0)
    """rank R of the bilinear part of B; 0: B is constant"""
    saturating_gains: bool = True
    """the bilinear part is bounded: each factor is the hyperbolic tangent of a linear function of
    the lifted state"""
    drift_rank: int = Field(default=10, ge=0)
    """rank of the saturating part of the motion without inputs; 0: it is linear, as it is if the
    gains do not saturate"""
    bilinear_follows: Follow = Follow.PREDICTION
    """lifted state that determines the bilinear part over a roll-out: the predicted one of each
    step, the free response of psi_0, or psi_0"""

    episodes: PositiveInt = 7_000
    """episodes of 10 s in the data set"""
    data_seed: int = 0
    """seed of the data set"""
    largest_steer_deg: LargestSteer | None = None
    """largest angle of the steering wheel in the data set; none: what a plan may use, up to 300"""


RECOMMENDED = TrainingConfig()

# The paper's network and table of hyperparameters. Eq. (11), the prior of A in eq. (12), and the
# rules that keep a model, lower the rate and end the training are replaced: docs/decisions/030.
PAPER = TrainingConfig(
    preset="paper",
    steps=60_000,
    batch=128,
    windows="slices",
    rare_share=0.0,
    symmetry="none",
    noise=0.0,
    optimizer="adam",
    learning_rate=1e-3,
    operator_rate=1.0,
    rate_schedule="plateau",
    patience=3,
    evaluate_every=500,
    gradient_clip=None,
    objective="paper",
    forgetting=0.9,
    weight_single_step=1.0,
    weight_multi_step=0.5,
    weight_stability=1.6,
    weight_regularisation=1e-4,
    decay_encoder=0.9,
    decay_operator=0.5,
    stability="gelfand",
    activation="relu",
    hidden=(32, 64, 128, 128, 64),
    latents=60,
    latents_start="identity",
    separate_motion=False,
    lift_exogenous=False,
    products=False,
    history_steps=0,
    bilinear_rank=0,
    saturating_gains=False,
    drift_rank=0,
)

PRESETS = {
    "recommended": RECOMMENDED,
    # For a microcontroller. The fewer observables, the more a penalty on growth is needed.
    "small": RECOMMENDED.model_copy(
        update={
            "preset": "small",
            "hidden": (32, 32),
            "latents": 18,
            "bilinear_rank": 4,
            "drift_rank": 6,
            "weight_stability": 400.0,
        }
    ),
    # The best model found with a constant B, as in the paper.
    "linear": RECOMMENDED.model_copy(
        update={"preset": "linear", "bilinear_rank": 0, "drift_rank": 0}
    ),
    "paper": PAPER,
    # Algorithm 1 and eqs. (9)-(13) as printed, also where this costs accuracy; beyond the paper,
    # the gradient is limited and training ends after ten halvings of the rate.
    "paper-literal": PAPER.model_copy(
        update={
            "preset": "paper-literal",
            "best_rule": "as-printed",
            "operator_prior": "zero",
            "stability": "eigenvalue",
            "through_last_step": False,
            "constant_observable": False,
            # the gradient of eq. (11) is unbounded where eigenvalues coincide
            "gradient_clip": 10.0,
        }
    ),
    # A model within minutes. Another data seed, so that its episodes are not in the full data set,
    # on whose test trajectories it can then be evaluated.
    "quick": RECOMMENDED.model_copy(
        update={
            "preset": "quick",
            "steps": 1_600,
            "evaluate_every": 200,
            "episodes": 1_000,
            "data_seed": 1,
        }
    ),
}


def explicit_fields(chosen: TrainingConfig | None) -> dict[str, Any]:
    """The fields that were given on the command line, with their values."""
    return {} if chosen is None else chosen.model_dump(exclude_unset=True)


def resolve(chosen: TrainingConfig | None) -> TrainingConfig:
    """The chosen preset with the explicitly given fields.

    Raises:
        ConfigError: there is no such preset.
    """
    preset = RECOMMENDED.preset if chosen is None else chosen.preset
    if preset not in PRESETS:
        raise ConfigError(f"--preset: expected one of {', '.join(PRESETS)}, found {preset!r}.")
    return PRESETS[preset].model_copy(update=explicit_fields(chosen))
