"""Places in the rows of floats that the kernels of a machine read and write.

One row of constants and one of state a machine. SI, angles in rad at the motor shaft, positive in
the closing direction. Flags are 0.0 or 1.0.
"""

# --- constants of a machine ------------------------------------------------------------------
(
    MOTOR_CIRCUIT,  # one of `turnout.machine.compute.motor`
    VOLTAGE,  # of the supply [V]
    RESISTANCE,  # of the copper in the motor circuit, at its temperature [ohm]
    LINE_RESISTANCE,  # of line and supply [ohm]
    SNUB_RESISTANCE,  # in the circuit after cut-off [ohm]
    OPEN_AFTER,  # 1: the armature is open after cut-off, otherwise closed over the snubber
    INDUCTANCE,  # [H]
    MOTOR_CONSTANT,  # k [V s/rad], or K [V s/(rad A)] of a series motor
    INVERSE_SATURATION,  # 1/i_s [1/A]
    BRUSH_DROP,  # [V]
    FIELD_POWER,  # of a separate field winding while energised [W]
    LOSS_TORQUE,  # T_0 [N m]
    BRAKE_TORQUE,  # T_b, when de-energised [N m]
    MOTOR_DRAG,  # c1 [N m s/rad]
    MOTOR_INERTIA,  # J1 [kg m^2]
    CLUTCH_STIFFNESS,  # k_c [N m/rad]
    CLUTCH_TORQUE,  # T_s while slipping, new and at ambient temperature [N m]
    STATIC_RATIO,  # breakaway torque over T_s
    LEVEL_PER_KELVIN,  # of T_s [1/K]
    LEVEL_PER_JOULE,  # of T_s, lost by wear [1/J]
    CLUTCH_HEAT_CAPACITY,  # [J/K]
    CLUTCH_COOLING,  # 1/time constant [1/s]
    GEAR_INERTIA,  # J2 [kg m^2]
    GEAR_DRAG,  # c2 [N m s/rad]
    FACTOR_DRIVING,  # torque at the shaft over load when it drives, 1/eta
    FACTOR_DRIVEN,  # the same when it is driven back
    STROKE_KIND,  # SCREW, CRANK or TABLE
    RATIO,  # N [rad/m] of a screw; shaft angle of the whole stroke [rad] of crank and table
    STROKE,  # [m], crank and table
    STROKE_START,  # rod position at shaft angle 0 [m], crank and table
    ROD_STIFFNESS,  # [N/m]
    ROD_PLAY,  # lost motion, whole [m]
    LIMIT_CLOSING,  # shaft angle of the limit contact [rad]
    LIMIT_OPENING,
    CONTACTOR_DELAY,  # after a command [s]
    CUTOFF_DELAY,  # after the limit contact [s]
    TIME_OUT,  # after the contactor [s]
    OVERLOAD_CURRENT,  # [A]
    OVERLOAD_TIME,  # [s]
    DETECTION_OPEN,  # rod position below which the end contact "open" is made [m]
    DETECTION_CLOSED,  # rod position above which the end contact "closed" is made [m]
    HOLDS,  # 1: a lock holds J2 from its first standstill after cut-off to the next contactor
    HAND_GAIN,  # torque per speed that the crank lags behind the hand [N m s/rad]; 0: no crank
    HAND_SPEED,  # [rad/s]
    HAND_RAMP,  # [s]
    HAND_STAYS,  # 1: the hand does not let go at the limit contact
    STEADY_CIRCUIT,  # 1: the fluxes of an induction motor follow at once
    PHASE_VOLTAGE,  # peak, line to neutral [V]
    SUPPLY_SPEED,  # 2 pi f [rad/s]
    POLE_PAIRS,
    ROTOR_RESISTANCE,  # R_r, seen from the stator [ohm]; the stator's is RESISTANCE
    STATOR_INDUCTANCE,  # L_s at the rated flux [H]
    MAIN_BEND,  # c of the main branch, 0 without saturation
    RATED_FLUX,  # peak [V s]
    LEAKAGE_INDUCTANCE,  # L_l, all on the rotor's side [H]
    IRON_CONDUCTANCE,  # 1/R_fe across the terminals [1/ohm]
    PHASE_LOST_TIME,  # at which one conductor of an induction motor's supply opens [s]
    LONGEST_STEP,  # of the machine within a step of the rails [s]
    DRY_RATIO,  # of the gear's efficiency where it is dry to that where it is not; 1: nowhere dry
    DRY_FROM,  # rod positions between which it is dry [m]
    DRY_TO,
    CONTACT_LOSS,  # share of each turn of the motor in which a brush has poor contact
    CONTACT_RESISTANCE,  # added there [ohm]
    LOCK_TORQUE,  # while the lock bar moves [N m]
    UNLOCKED_FROM,  # shaft angles between which the rod moves and the bar stands [rad]
    UNLOCKED_TO,
    CONSTANTS,
) = range(67)

(SCREW, CRANK, TABLE) = range(3)
"""Kinds of stroke: rod position over shaft angle."""

# --- the rail at the rod -----------------------------------------------------------------------
(
    RAIL_START,  # position at the start of the step [m]
    RAIL_START_SPEED,  # [m/s]
    RAIL_FREE,  # position at the end of the step without any rod force in that step's end [m]
    RAIL_TIME,  # of the start of the step [s]
    RAIL_STEP,  # its length [s]
    RAIL_COMPLIANCE,  # displacement at the end of the step per rod force there [m/N]
    RAIL_CONSTANTS,
) = range(7)

# --- state -------------------------------------------------------------------------------------
(
    ROD_POSITION,  # x [m]
    SLIP,  # of the clutch, th1 - th2 - a [rad]
    CURRENT,  # of the motor; of an induction motor that of the line, rms [A]
    GEAR_SPEED,  # w2 [rad/s]
    SPEED,  # of the motor, w1 [rad/s]
    TWIST,  # of the clutch, a [rad]
    GEAR_ANGLE,  # th2 [rad]
    STATOR_FLUX,  # of an induction motor, along the supply's voltage [V s]
    STATOR_FLUX_ACROSS,  # a quarter of a turn ahead of it
    ROTOR_FLUX,
    ROTOR_FLUX_ACROSS,
    ROD_FORCE,  # [N]
    ENERGISED,
    DIRECTION,  # 1 closing, -1 opening
    SUPPLIED,  # voltage at the motor circuit [V]
    ARMATURE_OPEN,
    LOCKED,
    SHARED_DROP,  # voltage that the other machines on the supply take [V], set from outside;
    # of an induction motor the part along the supply's voltage, peak
    SHARED_DROP_ACROSS,  # its part a quarter of a turn ahead, 0 of a direct current
    PHASE_LOST,  # 1: one conductor of an induction motor's supply is open
    MAIN_EXCESS,  # current per flux of the main branch over that at the rated flux, less 1
    CLUTCH_TEMPERATURE,  # above ambient [K]
    HEAT_COUNTED,  # heat of the clutch that is in its temperature already [J]
    SLIPPING,  # sign of the slip while the clutch is at its kinetic level, else 0
    LEVEL,  # torque at which the clutch slips now [N m]
    CIRCUIT_RESISTANCE,  # [ohm]
    STILL_TORQUE,  # dry friction torque at the motor, T_0 and brake [N m]
    HAND_SINCE,  # time at which the hand began to turn [s]
    HAND_ON,
    CONTACTOR_TIME,  # of the last closing [s]
    CUTOFF_TIME,  # planned [s], inf without a plan
    OVERLOAD_SINCE,  # [s], inf while the current is below
    NEXT_COMMAND,  # index of the next command
    LOCK_ALLOWED,  # 0: the limit contact may not act, set from outside
    EVENTS,  # number logged
    HALVED,  # steps taken in halves so far
    GEAR_RATIO,  # DRY_RATIO where the gear is dry, else 1
    BRUSH_RESISTANCE,  # CONTACT_RESISTANCE while a brush has poor contact, else 0 [ohm]
    BAR_TORQUE,  # LOCK_TORQUE while the lock bar moves, else 0 [N m]
    ENERGIES,  # the first of the sums below
) = range(40)

INTEGRATED, PAST_INTEGRATED = CURRENT, ROTOR_FLUX_ACROSS + 1
"""The first state that obeys a differential equation, and the first one after those that do."""
FOLLOWED, TRACED = 4, 21
"""So many states, from the first on, are those that movements, slips and the current of a motor
follow from, and so many those that all channels over time follow from."""

# --- sums of power times step by the scheme's own weights [J] -----------------------------------
(
    SUPPLY,
    COPPER,
    LINE,
    BRUSH,
    SNUB,
    FIELD,  # separate field winding, or the iron of an induction motor
    MOTOR_FRICTION,
    MOTOR_DRAG_HEAT,
    GEAR,
    GEAR_DRAG_HEAT,
    CLUTCH,
    HAND,
    ROD_INPUT,
    INTO_STORES,
    SUMS,
) = range(15)

STATES = ENERGIES + SUMS


# --- what the circuit did, and how a step ended ---------------------------------------------------
(
    EVENT_ON,
    EVENT_OFF_LIMIT,
    EVENT_OFF_TIME_OUT,
    EVENT_OFF_OVERLOAD,
    EVENT_LOCKED,
    EVENT_DETECTION_OPENS,
    EVENT_DETECTION_CLOSES,
    EVENT_PHASE_LOST,
) = range(8)

EVENT_TEXTS = (
    "on",
    "off limit",
    "off time-out",
    "off overload",
    "locked",
    "detection opens",
    "detection closes",
    "phase lost",
)

(CONVERGED, NOT_CONVERGED) = range(2)
