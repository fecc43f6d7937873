"""Entry points of the offline commands; their modules are imported when one is called."""

from functools import partial

from rt_controller.terminal.entry import start

data_main = partial(start, "offline-data", "offline.cli", "data_main")
import_main = partial(start, "offline-import", "offline.cli", "import_main")
train_main = partial(start, "offline-train", "offline.cli", "train_main")
export_main = partial(start, "offline-export", "offline.cli", "export_main")
evaluate_main = partial(start, "offline-evaluate", "offline.cli", "evaluate_main")
replay_main = partial(start, "offline-replay", "offline.cli", "replay_main")
