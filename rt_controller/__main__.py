"""Entry point of `rt-controller`, and of `python -m rt_controller`."""

from functools import partial

from rt_controller.terminal.entry import start

main = partial(start, "rt-controller", "rt_controller.cli")

if __name__ == "__main__":
    main()
