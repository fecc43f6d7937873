"""What a person may choose about a training run, and the presets.

No torch here: the command line reads it before anything heavy is loaded.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt

from rt_controller.contract.errors import ConfigError

Weight = Annotated[float, Field(ge=0.0)]


class TrainingConfig(BaseModel):
    """Every number of a training run; the defaults are the preset `paper`.

    Paper: table of hyperparameters. Its "epoch" is one mini-batch step, and the forgetting factor
    that the table calls gamma is the beta of eq. (10).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: str = Field(
        default="paper", description="starting point: paper, paper-literal or quick"
    )

    steps: PositiveInt = Field(default=60_000, description="mini-batch steps")
    batch: PositiveInt = Field(default=128, description="trajectories in a mini-batch")
    seed: int = Field(
        default=0, description="of the initial weights and of the sequence of batches"
    )
    threads: PositiveInt = Field(default=2, description="CPU threads of torch")

    learning_rate: PositiveFloat = Field(default=1e-3, description="Adam's rate at the start")
    patience: PositiveInt = Field(default=3, description="evaluations before the rate is halved")
    evaluate_every: PositiveInt = Field(default=500, description="steps between two evaluations")
    gradient_clip: PositiveFloat | None = Field(
        default=None, description="largest norm of the gradient; none: as it comes"
    )
    best_rule: Literal["global-minimum", "as-printed"] = Field(
        default="global-minimum",
        description="keep the model of the lowest validation loss, or go by Algorithm 1 as printed",
    )

    forgetting: float = Field(default=0.9, gt=0.0, le=1.0, description="beta of eq. (10)")
    weight_single_step: Weight = Field(default=1.0, description="alpha_1 of eq. (13)")
    weight_multi_step: Weight = Field(default=0.5, description="alpha_2 of eq. (13)")
    weight_stability: Weight = Field(default=1.6, description="alpha_3 of eq. (13)")
    weight_regularisation: Weight = Field(default=1e-4, description="alpha_4 of eq. (13)")
    decay_encoder: Weight = Field(default=0.9, description="lambda_theta of eq. (12)")
    decay_operator: Weight = Field(default=0.5, description="lambda_K of eq. (12)")
    operator_prior: Literal["identity", "zero"] = Field(
        default="identity",
        description="what A starts near and is pulled towards; eq. (12) as printed says zero",
    )
    stability: Literal["gelfand", "eigenvalue"] = Field(
        default="gelfand", description="bound on the growth of A^64, or eq. (11) as printed"
    )
    through_last_step: bool = Field(
        default=True, description="eq. (10) up to step K instead of the printed K-1"
    )
    target_samples: PositiveInt | None = Field(
        default=None,
        description="encode only so many random target times a batch (unbiased estimate of the "
        "sums); none: every one of them",
    )

    hidden: tuple[PositiveInt, ...] = Field(
        default=(32, 64, 128, 128, 64), description="widths of the encoder's hidden layers"
    )
    latents: PositiveInt = Field(
        default=60, description="P, observables beside the physical states"
    )
    constant_observable: bool = Field(
        default=True,
        description="one of the latents is the constant 1, so that A and B need no bias",
    )

    episodes: PositiveInt = Field(default=7_000, description="episodes of 10 s in the data set")
    data_seed: int = Field(default=0, description="of the data set")


PRESETS = {
    "paper": TrainingConfig(),
    # Algorithm 1 and eqs. (9)-(13) to the letter, also where the letter costs accuracy.
    "paper-literal": TrainingConfig(
        preset="paper-literal",
        best_rule="as-printed",
        operator_prior="zero",
        stability="eigenvalue",
        through_last_step=False,
        constant_observable=False,
        gradient_clip=10.0,  # the gradient of eq. (11) has no bound where eigenvalues meet
    ),
    # A first drive within a coffee break. Another seed, so that its data share no episode with the
    # full data set and a quick model may be judged on the latter's test trajectories.
    "quick": TrainingConfig(
        preset="quick",
        threads=1,  # batches are small: a second thread waits more than it works
        steps=4_000,
        batch=64,
        learning_rate=2e-3,
        patience=1,
        evaluate_every=250,
        target_samples=8,
        episodes=1_000,
        data_seed=1,
    ),
}


def resolve(chosen: TrainingConfig | None) -> TrainingConfig:
    """The preset that was asked for, with every explicitly chosen field in place of its own.

    Raises:
        ConfigError: there is no such preset.
    """
    if chosen is None:
        return PRESETS["paper"]
    if chosen.preset not in PRESETS:
        raise ConfigError(
            f"--preset: expected one of {', '.join(PRESETS)}, found {chosen.preset!r}."
        )
    explicit = {name: getattr(chosen, name) for name in chosen.model_fields_set}
    return PRESETS[chosen.preset].model_copy(update=explicit)
