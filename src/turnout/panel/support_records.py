"""What rails rest on, are held by and strike, as records."""

from pydantic import Field

from turnout.files.quantity import (
    AngularStiffness,
    Damping,
    Length,
    LengthList,
    Stiffness,
)
from turnout.panel.record import OnRails


class Chair(OnRails):
    """Slide chair: unilateral vertical contact and Coulomb friction at each foot point."""

    foot_offsets: LengthList | None = Field(
        None,
        description="y of the foot points, towards the rail's stock rail [m]; default the edges of "
        "the underside where the section is an outline, else the reference line",
    )
    foot_height: Length = Field(0.0, ge=-1, le=1, description="z of the foot points [m]")
    normal_stiffness: Stiffness = Field(gt=0, description="contact stiffness a foot point [N/m]")
    friction_coefficient: float = Field(ge=0, le=2, description="Coulomb friction [-]")
    stick_stiffness: Stiffness = Field(gt=0, description="tangential stiffness a foot point [N/m]")
    damping: Damping = Field(0.0, ge=0, description="vertical dashpot a foot point [N s/m]")
    clearance: Length = Field(0.0, description="free distance under the unloaded foot [m]")


class Fastening(OnRails):
    """Linear spring and damper in six directions between rail and sleeper."""

    height: Length = Field(0.0, ge=-1, le=1, description="z at which it acts [m]")
    offset: Length | None = Field(
        None,
        ge=-1,
        le=1,
        description="y at which it acts, towards the rail's stock rail [m]; default the middle of "
        "the underside where the section is an outline, else the reference line",
    )
    stiffness_x: Stiffness = Field(0.0, ge=0, description="along x [N/m]")
    stiffness_y: Stiffness = Field(0.0, ge=0, description="along y [N/m]")
    stiffness_z: Stiffness = Field(0.0, ge=0, description="along z [N/m]")
    stiffness_roll: AngularStiffness = Field(0.0, ge=0, description="about x [N m/rad]")
    stiffness_pitch: AngularStiffness = Field(0.0, ge=0, description="about y [N m/rad]")
    stiffness_yaw: AngularStiffness = Field(0.0, ge=0, description="about z [N m/rad]")
    damping_x: Damping = Field(0.0, ge=0, description="along x [N s/m]")
    damping_y: Damping = Field(0.0, ge=0, description="along y [N s/m]")
    damping_z: Damping = Field(0.0, ge=0, description="along z [N s/m]")


class Stop(OnRails):
    """Unilateral lateral contact of the switch rail with the stock rail or a stud."""

    height: Length = Field(ge=-1, le=1, description="z of the contact [m]")
    stiffness: Stiffness = Field(gt=0, description="[N/m]")
    clearance: Length = Field(0.0, description="added to the stock rail gap at this place [m]")
