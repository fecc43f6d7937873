"""Recording of drives, and what is made of a recording; `rt_controller.bus` comes before `can`."""

import rt_controller.bus  # noqa: F401  hides asammdf from python-can, for a fast start
