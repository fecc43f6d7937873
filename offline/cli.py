"""`offline-ablate`, whose work is in `offline.commands.ablation`."""

from functools import partial

from offline.commands.ablation import ablate
from offline.commands.options import TRAINING_GROUPS
from rt_controller.terminal.command_line import new_app, run_command

ablate_app = new_app(
    "offline-ablate",
    "Train variants of a model on the same data, and compare them.",
    "[VARIANTS]",
    TRAINING_GROUPS,
)
ablate_app.default(ablate)
ablate_main = partial(run_command, ablate_app)
