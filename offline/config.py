"""What a person may choose about a training run, and the presets.

No torch here: the command line reads it before anything heavy is loaded.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt

from offline.lengths import PAST_STEPS, STEPS
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.follow import Follow

Weight = Annotated[float, Field(ge=0.0)]


class TrainingConfig(BaseModel):
    """Every number of a training run; the fields' defaults are the preset `recommended`.

    Where a field has a counterpart in the paper, it says so. What the paper calls an epoch is one
    mini-batch step here, and the forgetting factor that its table calls gamma is the beta of its
    eq. (10).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: str = Field(
        default="recommended",
        description="starting point: recommended, linear, paper, paper-literal or quick",
    )

    steps: PositiveInt = Field(default=50_000, description="mini-batch steps")
    batch: PositiveInt = Field(default=256, description="trajectories in a mini-batch")
    seed: int = Field(
        default=0, description="of the initial weights and of the sequence of batches"
    )
    threads: PositiveInt = Field(default=2, description="CPU threads of torch")
    device: str = Field(default="cpu", description="of torch: cpu, cuda, cuda:1, …")

    windows: Literal["all", "slices"] = Field(
        default="all",
        description="learn from any window of any drive, with roads laid anew under those that "
        "have poses, or from the paper's slices",
    )
    mirror: bool = Field(
        default=True,
        description="half of the trajectories with left and right exchanged, if the data set says "
        "which signals change sign",
    )

    learning_rate: PositiveFloat = Field(
        default=2e-3, description="Adam's rate at the start, or at the top of the cosine"
    )
    operator_rate: float = Field(
        default=0.1,
        gt=0.0,
        description="rate of A as a share of the rate: over 80 steps a small change of A is a "
        "large one of the prediction",
    )
    rate_schedule: Literal["cosine", "plateau"] = Field(
        default="cosine",
        description="warm up over 5 % of the steps and let the rate fall to zero as half a "
        "cosine, or halve it when the validation loss stalls",
    )
    patience: PositiveInt = Field(
        default=3, description="evaluations before a plateau halves the rate"
    )
    evaluate_every: PositiveInt = Field(default=1_000, description="steps between two evaluations")
    gradient_clip: PositiveFloat | None = Field(
        default=5.0, description="largest norm of the gradient; none: as it comes"
    )
    best_rule: Literal["global-minimum", "as-printed"] = Field(
        default="global-minimum",
        description="keep the model of the lowest validation loss, or go by Algorithm 1 as printed",
    )

    objective: Literal["horizon", "paper"] = Field(
        default="horizon",
        description="the log error of the physical states over the whole horizon, or eqs. (9) "
        "and (10)",
    )
    horizon_start: PositiveInt | None = Field(
        default=8,
        le=STEPS,
        description="steps of the first roll-outs of the horizon objective; none: the whole "
        "horizon",
    )
    horizon_growth: float = Field(
        default=0.3, gt=0.0, le=1.0, description="share of the steps after which it is whole"
    )
    forgetting: float = Field(default=0.9, gt=0.0, le=1.0, description="beta of eq. (10)")
    weight_single_step: Weight = Field(default=0.0, description="alpha_1 of eq. (13)")
    weight_multi_step: Weight = Field(default=1.0, description="alpha_2 of eq. (13)")
    weight_stability: Weight = Field(default=0.0, description="alpha_3 of eq. (13)")
    weight_regularisation: Weight = Field(default=1e-4, description="alpha_4 of eq. (13)")
    decay_encoder: Weight = Field(default=0.9, description="lambda_theta of eq. (12)")
    decay_operator: Weight = Field(default=0.0, description="lambda_K of eq. (12)")
    operator_prior: Literal["identity", "zero"] = Field(
        default="identity",
        description="what A starts near and is pulled towards; eq. (12) as printed says zero",
    )
    stability: Literal["projection", "gelfand", "eigenvalue"] = Field(
        default="projection",
        description="eigenvalues put back to the unit circle every ten steps, a bound on the "
        "growth of A^64, or eq. (11) as printed",
    )
    through_last_step: bool = Field(
        default=True, description="eq. (10) up to step K instead of the printed K-1"
    )
    target_samples: PositiveInt | None = Field(
        default=None,
        description="encode only so many random target times a batch (unbiased estimate of the "
        "sums); none: every one of them",
    )

    activation: Literal["silu", "relu"] = Field(
        default="silu", description="after every hidden layer of the encoder"
    )
    hidden: tuple[PositiveInt, ...] = Field(
        default=(128, 128), description="widths of the encoder's hidden layers"
    )
    latents: PositiveInt = Field(
        default=60, description="P, observables beside the physical states"
    )
    latents_start: Literal["fading", "identity"] = Field(
        default="fading",
        description="latents at the start: small, with time constants spread from 0.05 to 5 s in "
        "A, or lasting",
    )
    constant_observable: bool = Field(
        default=True,
        description="one of the latents is the constant 1, so that A and B need no bias",
    )
    lift_exogenous: bool = Field(
        default=True, description="the encoder sees the exogenous signals: curvature"
    )
    products: bool = Field(
        default=True,
        description="the encoder adds a linear layer of all products of two states and, if it "
        "sees them, exogenous signals",
    )
    history_steps: int = Field(
        default=8, ge=0, le=PAST_STEPS, description="past periods that the encoder sees"
    )
    bilinear_rank: int = Field(
        default=8, ge=0, description="R of the bilinear part of B; 0: B is constant"
    )
    bilinear_follows: Follow = Field(
        default=Follow.PREDICTION,
        description="what the bilinear part is read from over a roll-out: the lifted state of each "
        "step, what psi_0 becomes without inputs, or psi_0 alone",
    )

    episodes: PositiveInt = Field(default=7_000, description="episodes of 10 s in the data set")
    data_seed: int = Field(default=0, description="of the data set")


RECOMMENDED = TrainingConfig()

# The paper's table of hyperparameters. Where text, table and algorithm disagree or are silent,
# docs/decisions/030 says how they are read.
PAPER = TrainingConfig(
    preset="paper",
    steps=60_000,
    batch=128,
    windows="slices",
    mirror=False,
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
    lift_exogenous=False,
    products=False,
    history_steps=0,
    bilinear_rank=0,
)

PRESETS = {
    "recommended": RECOMMENDED,
    # The best model found whose B is a constant, as in the paper.
    "linear": RECOMMENDED.model_copy(update={"preset": "linear", "bilinear_rank": 0}),
    "paper": PAPER,
    # Algorithm 1 and eqs. (9)-(13) to the letter, also where the letter costs accuracy.
    "paper-literal": PAPER.model_copy(
        update={
            "preset": "paper-literal",
            "best_rule": "as-printed",
            "operator_prior": "zero",
            "stability": "eigenvalue",
            "through_last_step": False,
            "constant_observable": False,
            # the gradient of eq. (11) has no bound where eigenvalues meet
            "gradient_clip": 10.0,
        }
    ),
    # A first drive within a coffee break. Another seed, so that its data share no episode with the
    # full data set and a quick model may be judged on the latter's test trajectories.
    "quick": RECOMMENDED.model_copy(
        update={
            "preset": "quick",
            "threads": 1,  # batches are small: a second thread waits more than it works
            "steps": 3_000,
            "batch": 128,
            "evaluate_every": 250,
            "episodes": 1_000,
            "data_seed": 1,
        }
    ),
}


def restore_config(fields: Mapping[str, Any]) -> TrainingConfig:
    """A configuration that was written down before: every field of it, none by default.

    Raises:
        ValueError: a field is missing, unknown or out of range: it is of another version.
    """
    missing = sorted(set(TrainingConfig.model_fields) - set(fields))
    if missing:
        raise ValueError(f"the configuration lacks {', '.join(missing)}")
    return TrainingConfig.model_validate(dict(fields))


def resolve(chosen: TrainingConfig | None) -> TrainingConfig:
    """The preset that was asked for, with every explicitly chosen field in place of its own.

    Raises:
        ConfigError: there is no such preset.
    """
    if chosen is None:
        return RECOMMENDED
    if chosen.preset not in PRESETS:
        raise ConfigError(
            f"--preset: expected one of {', '.join(PRESETS)}, found {chosen.preset!r}."
        )
    explicit = {name: getattr(chosen, name) for name in chosen.model_fields_set}
    return PRESETS[chosen.preset].model_copy(update=explicit)
