"""Entry point of `sim-bridge`, and of `python -m sim_bridge`."""

from functools import partial

from rt_controller.terminal.entry import start

main = partial(start, "sim-bridge", "sim_bridge.cli")

if __name__ == "__main__":
    main()
