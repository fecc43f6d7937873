"""Names of the cars that come with the package; nothing here needs the compiler."""

from sim_bridge.toml_file import shipped_names

CARS_FOLDER = "cars"
DEFAULT_CAR = "c_class_150kw_awd"
"""the car of the training data"""


def shipped_cars() -> list[str]:
    """Names of the cars that come with the package."""
    return shipped_names(CARS_FOLDER)
