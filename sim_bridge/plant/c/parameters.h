/* The numbers of a car. Each name ends in its unit; a name without one has no dimension.
 *
 * All fields are doubles in the order of the record that `car_record` makes in Python, so that this
 * record is passed to C as it is. Values and their sources stand in the car files. */

#ifndef PARAMETERS_H
#define PARAMETERS_H

#define N_MAP 8   /* speeds and pedal positions of a torque map */
#define N_GEARS 6

/* Masses, inertias and where they sit; the rest of the car hangs on these lengths. */
typedef struct {
    double mass_kg;
    double yaw_inertia_kgm2;
    double front_axle_m; /* from the centre of gravity of the whole car forward to the front axle */
    double rear_axle_m; /* backward to the rear axle, positive */
    double track_front_m;
    double track_rear_m;
    double width_m; /* of the body; for lanes, not for dynamics */
    double sprung_mass_kg;
    double sprung_roll_inertia_kgm2;
    double sprung_pitch_inertia_kgm2;
    /* from the centre of gravity of the sprung mass forward to the front axle */
    double sprung_front_axle_m;
    double sprung_rear_axle_m;
    double sprung_height_m;
    double unsprung_front_kg; /* both wheels of the axle */
    double unsprung_rear_kg;
    double unsprung_height_m;
} BodyParameters;

/* What stands between body and wheels, seen at the wheels; chassis.c. */
typedef struct {
    double spring_front_npm;
    double spring_rear_npm;
    double bar_front_nmprad;
    double bar_rear_nmprad;
    /* damping of slow motion at the wheel, while the wheel moves towards the body */
    double jounce_front_nspm;
    double jounce_rear_nspm;
    double rebound_front_nspm; /* the same while it moves away */
    double rebound_rear_nspm;
    /* slope far above the knee; equal to the slow one: a linear damper */
    double jounce_front_fast_nspm;
    double jounce_rear_fast_nspm;
    double rebound_front_fast_nspm;
    double rebound_rear_fast_nspm;
    /* speed of the wheel against the body around which the slope changes */
    double damper_knee_front_mps;
    double damper_knee_rear_mps;
    /* travel from rest in either direction at which the wheel meets bump or rebound stop */
    double stop_gap_front_m;
    double stop_gap_rear_m;
    /* force of a stop at the wheel per square of its compression; 0: no stops */
    double stop_front_npm2;
    double stop_rear_npm2;
    double roll_centre_front_m;
    double roll_centre_rear_m;
    /* upward force on the body per force of a brake at the wheel: against the dive */
    double arm_slope_front;
    /* downward force on the body per force of a brake at the wheel: against the lift */
    double arm_slope_rear;
    /* as the arm slopes, for forces at the wheel centre: drive torque, which the body carries */
    double centre_slope_front;
    double centre_slope_rear;
    /* road-wheel angle per roll angle against the wheels, positive into the turn */
    double roll_steer_front;
    double roll_steer_rear;
    /* wheel angle per lateral force of the axle, positive into the turn (with the force) */
    double lateral_steer_front_radpn;
    double lateral_steer_rear_radpn;
    /* wheel angle per aligning moment of the axle, positive in the direction of the moment */
    double aligning_steer_front_radpnm;
    double aligning_steer_rear_radpnm;
    double compliance_lag_s; /* of the wheel angles behind force and moment */
    double camber_gain_front; /* wheel lean against the ground per roll angle */
    double camber_gain_rear;
} SuspensionParameters;

/* Magic Formula of one tyre on the reference road; tyre.c. */
typedef struct {
    double rolling_radius_m;
    double spin_inertia_kgm2;
    double vertical_stiffness_npm;
    double vertical_damping_nspm;
    double reference_load_n;
    double lateral_friction;
    double longitudinal_friction;
    /* relative change per relative excess over the reference load */
    double lateral_friction_per_load;
    double longitudinal_friction_per_load;
    double cornering_stiffness_npr; /* at the load at which it would peak */
    double cornering_stiffness_load_n; /* that load */
    double lateral_shape; /* C of the Magic Formula */
    double lateral_curvature; /* E of the Magic Formula */
    double slip_stiffness; /* longitudinal force per slip and load */
    double longitudinal_shape;
    double longitudinal_curvature;
    double lateral_weight; /* how fast lateral force fades with longitudinal slip */
    double longitudinal_weight; /* how fast longitudinal force fades with lateral slip */
    double camber_slip; /* equivalent lateral slip per radian of lean */
    double trail_m;
    double trail_shape;
    double trail_stiffness; /* per slip; with the shape it says where the pneumatic trail ends */
    double lateral_relaxation_m;
    double longitudinal_relaxation_m;
    double relaxation_load_n; /* load for which the two relaxation lengths hold */
    double lateral_relaxation_start_slip; /* slip from which the relaxation length fades */
    double lateral_relaxation_end_slip; /* slip at which it has faded */
    double longitudinal_relaxation_end_slip;
    /* speed at which the material damping of the tyre has lost half its effect */
    double damping_end_mps;
    double lateral_damping_s;
    /* limited for light wheels: wheels.c */
    double longitudinal_damping_s;
    /* largest moment of a standing tyre against turning about the vertical, at the reference
     * load and on the road of the tyre test */
    double parking_torque_nm;
    double parking_twist_rad; /* turning angle over which the moment builds up */
    double parking_length_m; /* rolling distance over which it decays */
    double rolling_resistance;
    double rolling_resistance_spm; /* growth with speed, per m/s */
} TyreParameters;

/* From the gearbox to the wheels; drive.c. */
typedef struct {
    double final_ratio;
    double final_efficiency;
    double front_share;
    double viscous_nms; /* torque at the propeller shafts per difference of their speeds */
    double shaft_stiffness_nmprad; /* of all shafts together, at the wheels */
    double shaft_damping_nms;
} DrivelineParameters;

/* From the pedal to the discs; drive.c. */
typedef struct {
    double pedal_mpa_per_n;
    double lag_s;
    double knee_mpa;
    double slope_above_knee;
    double front_nm_per_mpa;
    double rear_nm_per_mpa;
} BrakeParameters;

/* From the steering wheel to the front wheels, seen at the front wheels; wheels.c. */
typedef struct {
    double ratio;
    double stiffness_nmprad;
    double damping_nms;
    double inertia_kgm2;
    double friction_nm;
    double caster_trail_m;
    /* share of the difference of the wheel angles with which all wheels roll freely */
    double ackermann;
    double lock_rad; /* largest angle of the steering wheel */
} SteeringParameters;

/* Air forces; chassis.c. */
typedef struct {
    double air_density_kgpm3;
    double area_m2;
    double drag;
    double lift;
    /* coefficient of side force per radian of the direction of the air flow */
    double side_force_slope;
    /* of the centre of gravity of the whole car: where the side force acts */
    double side_force_ahead_m;
} AeroParameters;

/* The ground under the car and the wind, constant over a control period. */
typedef struct {
    double friction_left;
    double friction_right;
    double bank_rad; /* cross slope, positive if the left side is higher */
    double grade_rad; /* positive uphill */
    /* speed of the air over ground in the axes of the car: a tail wind is positive */
    double wind_forward_mps;
    double wind_left_mps;
} RoadParameters;

/* Combustion engine: torque map, idle governor, speed limit; drive.c. */
typedef struct {
    double inertia_kgm2;
    double map_speeds_rpm[N_MAP];
    double map_throttles[N_MAP];
    /* torque at the crankshaft; the row of the closed throttle is the drag of the engine */
    double map_nm[N_MAP][N_MAP];
    double idle_speed_rpm;
    double idle_gain_nm_per_rpm;
    double idle_torque_limit_nm;
    double speed_limit_rpm;
    double throttle_lag_s;
} EngineParameters;

/* Hydrodynamic torque converter; drive.c. */
typedef struct {
    double stall_torque_ratio;
    double coupling_speed_ratio;
    double capacity_nm_per_rpm2; /* torque at stall over engine speed squared */
    double capacity_fade; /* power of the speed ratio with which the capacity fades */
    /* of everything between the converter and the shafts' give, at turbine speed */
    double turbine_inertia_kgm2;
} ConverterParameters;

/* Ratios, efficiencies and the shift map; drive.c. */
typedef struct {
    double ratios[N_GEARS];
    double efficiencies[N_GEARS];
    double shift_time_s;
    double shift_dip; /* share of the engine's torque taken back in the middle of an up-shift */
    double dwell_s; /* shortest time from one shift's start to the next */
    /* turbine speed of an up-shift with the throttle closed; then open, then down-shifts alike */
    double up_rpm;
    double up_rpm_full;
    double down_rpm;
    double down_rpm_full;
    /* power of the throttle with which the shift speeds rise from closed to open */
    double shift_shape;
} GearboxParameters;

/* Electric motor, in place of engine, converter and gearbox; drive.c. */
typedef struct {
    /* of everything between the motor and the give of the shafts, at motor speed; 0: no motor */
    double inertia_kgm2;
    double map_speeds_rpm[N_MAP];
    double map_throttles[N_MAP];
    /* torque at the shaft; negative torque of the released pedal charges the battery */
    double map_nm[N_MAP][N_MAP];
    double lag_s;
} MotorParameters;

/* Anti-lock system with electronic brake-force distribution: it releases the brake of a wheel whose
 * slip is too large; drive.c. */
typedef struct {
    double slip; /* wanted largest slip; 0: no anti-lock system */
    double slip_band; /* deviation from the wanted slip at which the valves move with full speed */
    double release_per_s; /* share of the pressure released in a second */
    double apply_per_s;
    double least_speed_mps; /* below it the brakes are not released */
    double rear_share; /* largest slip of the rear wheels over that of the front wheels */
} AntiLockParameters;

/* Traction control: it reduces the torque of engine or motor; drive.c. */
typedef struct {
    double slip; /* wanted largest slip of the driven wheels; 0: no traction control */
    /* deviation from the wanted slip at which the torque changes with full speed */
    double slip_band;
    double cut_per_s; /* share of the torque taken away in a second */
    double restore_per_s;
} TractionControlParameters;

/* Coefficients of a `.tir` file, with its names in lower case; tyre_file.c. */
typedef struct {
    double fnomin; /* nominal load in N */
    double unloaded_radius; /* in m */
    double pcx1, pdx1, pkx1, pcy1;
    /* of either sign: a negative one also changes those of RVY1 to RVY3 and QBZ10 */
    double pdy1;
    double pky1; /* negative: side force against the slip angle */
    double pky2;
    /* 1 if the tyre was measured on the right side of a car (TYRESIDE), else 0 */
    double is_right;
    double lfzo, lcx, lmux, lex, lkx, lhx, lvx, lgax, lcy, lmuy, ley, lky, lhy, lvy, lgay, ltr,
        lres, lgaz, lxal, lyka, lvyka, ls, pdx2, pdx3, pex1, pex2, pex3, pex4, pkx2, pkx3, phx1,
        phx2, pvx1, pvx2, rbx1, rbx2, rbx3, rcx1, rex1, rex2, rhx1, pdy2, pdy3, pey1, pey2, pey3,
        pey4, pey5, pky3;
    double pky4; /* 2 in version 5.2, which has no such coefficient */
    double pky5, pky6, pky7, phy1, phy2, phy3, pvy1, pvy2, pvy3, pvy4, rby1, rby2, rby3, rby4,
        rcy1, rey1, rey2, rhy1, rhy2, rvy1, rvy2, rvy3, rvy4, rvy5, rvy6, qbz1, qbz2, qbz3, qbz4,
        qbz5, qbz9, qbz10, qcz1, qdz1, qdz2, qdz3, qdz4, qdz6, qdz7, qdz8, qdz9, qdz10, qdz11,
        qez1, qez2, qez3, qez4, qez5, qhz1, qhz2, qhz3, qhz4, ssz1, ssz2, ssz3, ssz4;
} TyreFileParameters;

/* A whole car on its road; the fields in the order of `Parameters` of the Python package. */
typedef struct {
    BodyParameters body;
    SuspensionParameters suspension;
    TyreParameters tyre;
    DrivelineParameters driveline;
    BrakeParameters brakes;
    SteeringParameters steering;
    AeroParameters aero;
    RoadParameters road;
    EngineParameters engine;
    ConverterParameters converter;
    GearboxParameters gearbox;
    MotorParameters motor;
    AntiLockParameters anti_lock;
    TractionControlParameters traction_control;
    TyreFileParameters tyre_file;
} Parameters;

#endif
