"""Which car the targets of the table belong to, by the name of its file."""

ALL_WHEEL = "c_class_150kw_awd"
FRONT_WHEEL = "c_class_125kw_fwd"
PEER = "commonroad_vehicle_2"
