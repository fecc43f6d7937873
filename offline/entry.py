"""Entry points of the offline commands; their modules are imported when one is called."""

from functools import partial

from rt_controller.terminal.entry import start

data_main = partial(start, "offline-data", "offline.commands.data")
import_main = partial(start, "offline-import", "offline.commands.import_logs")
train_main = partial(start, "offline-train", "offline.commands.train")
export_main = partial(start, "offline-export", "offline.commands.export")
evaluate_main = partial(start, "offline-evaluate", "offline.commands.evaluate")
replay_main = partial(start, "offline-replay", "offline.commands.replay")
fit_main = partial(start, "offline-fit", "offline.commands.fit")
