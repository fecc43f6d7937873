"""Print the score of each module of a cosmic-ray session, and the survivors.

`python .ci/mutation_score.py mutation.toml mutation.sqlite`; mutation.toml lists the survivors that
are equivalent.
"""

import sys
import tomllib
from collections import Counter
from pathlib import Path

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome


def score(config_file: str, session_file: str) -> None:
    config = tomllib.loads(Path(config_file).read_text())
    all_equivalent = {
        (each["module"], line) for each in config["equivalent"] for line in each["lines"]
    }
    killed, equivalent, survived = Counter[str](), Counter[str](), Counter[str]()
    with use_db(session_file, WorkDB.Mode.open) as database:
        for item, result in database.completed_work_items:
            if result.worker_outcome is not WorkerOutcome.NORMAL:
                continue
            (spec,) = item.mutations
            module = str(spec.module_path)
            if result.test_outcome is TestOutcome.KILLED:
                killed[module] += 1
                continue
            removed, added = (
                [row[1:].strip() for row in result.diff.splitlines()[2:] if row[0] == sign]
                for sign in "-+"
            )
            if (module, " ".join(added)) in all_equivalent:
                equivalent[module] += 1
                continue
            survived[module] += 1
            print(f"{module}:{spec.start_pos[0]}\n  - {' '.join(removed)}\n  + {' '.join(added)}")
        pending = len(database.pending_work_items)
    row = "{:42} {:>7} {:>8} {:>10} {:>7}".format
    print(row("module", "killed", "survived", "equivalent", "score"))
    modules = sorted({*killed, *survived, *equivalent})
    for module in modules:
        all_s = killed[module] + survived[module]
        share = f"{killed[module] / max(all_s, 1):.1%}"
        print(row(module, killed[module], survived[module], equivalent[module], share))
    totals = killed.total(), survived.total(), equivalent.total()
    print(row("all", *totals, f"{totals[0] / max(sum(totals[:2]), 1):.1%}"), f"{pending} pending")


if __name__ == "__main__":
    score(*sys.argv[1:])
