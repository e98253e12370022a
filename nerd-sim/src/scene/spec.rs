//! Scenes and contact materials in a robot's TOML.

use super::TerrainSpec;
use crate::{internal::*, range::exactly};

/// Largest stiffness (N/m); also largest damping and tangential damping (N s/m).
const MAX_STIFFNESS: f64 = 1e12;
/// Largest friction coefficient; also largest torsional and rolling friction (m).
const MAX_FRICTION: f64 = 1e6;

/// Compliant contact material; a pair of materials acts with the mean of both.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Normal stiffness k_e (N/m).
    pub stiffness: f64,
    /// Normal damping k_d (N s/m) while approaching.
    pub damping: f64,
    /// Tangential damping k_f (N s/m) of explicit steps. In implicit steps friction sticks.
    pub friction_damping: f64,
    /// Friction coefficient mu.
    pub friction: f64,
    /// Torsional friction (m): ratio of the largest torque about the normal to the normal force.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub torsion: f64,
    /// Rolling friction (m): ratio of the largest torque across the normal to the normal force.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rolling: f64,
    /// Contact margin (m): the force begins at this distance.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub margin: f64,
    /// Time constant (s) of resolving a penetration: while separating, the damping (N s/m) is the stiffness times this
    /// time. With a time of 0, as in the reference simulator, a body that starts in penetration is thrown out.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub release: f64,
}

/// Whether a number is the default 0, which is not written.
pub(crate) fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl Default for Material {
    /// The reference simulator's plane: stiffness 1e5 N/m, damping 1e3 N s/m, friction 0.5. Tangential damping is 1e5 N
    /// s/m in place of the reference's 1e3 N s/m. In explicit steps, a foot pushed sideways by 30 N then creeps at 0.3
    /// mm/s in place of 30 mm/s.
    fn default() -> Self {
        Self {
            stiffness: 1e5,
            damping: 1e3,
            friction_damping: 1e5,
            friction: 0.5,
            torsion: 0.0,
            rolling: 0.0,
            margin: 0.0,
            release: 0.0,
        }
    }
}

impl Material {
    /// Mean material of a pair.
    pub fn mean(&self, other: &Self) -> Self {
        let mean = |a: f64, b: f64| 0.5 * (a + b);
        Self {
            stiffness: mean(self.stiffness, other.stiffness),
            damping: mean(self.damping, other.damping),
            friction_damping: mean(self.friction_damping, other.friction_damping),
            friction: mean(self.friction, other.friction),
            torsion: mean(self.torsion, other.torsion),
            rolling: mean(self.rolling, other.rolling),
            margin: mean(self.margin, other.margin),
            release: mean(self.release, other.release),
        }
    }

    /// Damping (N s/m) at normal velocity `vn`, positive while separating.
    #[inline]
    pub(crate) fn damper(&self, vn: f64) -> f64 {
        if vn < 0.0 { self.damping } else { self.stiffness * self.release }
    }

    /// Refuses a number out of range.
    pub fn check(&self) -> Result<(), String> {
        within("`stiffness`", self.stiffness, 0.0..=MAX_STIFFNESS, "N/m")?;
        within("`damping`", self.damping, 0.0..=MAX_STIFFNESS, "N s/m")?;
        within("`friction_damping`", self.friction_damping, 0.0..=MAX_STIFFNESS, "N s/m")?;
        within("`friction`", self.friction, 0.0..=MAX_FRICTION, "")?;
        within("`torsion`", self.torsion, 0.0..=MAX_FRICTION, "m")?;
        within("`rolling`", self.rolling, 0.0..=MAX_FRICTION, "m")?;
        within("`margin`", self.margin, -1.0..=1.0, "m")?;
        within("`release`", self.release, 0.0..=1.0, "s")
    }
}

/// A named scene.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Name, as on the command line.
    pub name: String,
    /// Ground plane.
    pub plane: PlaneSpec,
    /// Uneven ground in place of the plane, with heights measured from the plane's height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terrain: Option<TerrainSpec>,
    /// Boxes.
    #[serde(default, rename = "box", skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<BoxSpec>,
    /// Pegs: upright cylinders.
    #[serde(default, rename = "peg", skip_serializing_if = "Vec::is_empty")]
    pub pegs: Vec<PegSpec>,
    /// Material [default: the robot's].
    pub material: Option<Material>,
}

/// A box with its third edge along the up axis.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BoxSpec {
    /// Edge lengths (m).
    #[serde(deserialize_with = "exactly")]
    pub size: [f64; 3],
    /// Centre (m), world axes.
    #[serde(deserialize_with = "exactly")]
    pub position: [f64; 3],
    /// Rotation about the up axis (rad).
    #[serde(default)]
    pub yaw: f64,
}

/// A cylinder along the up axis.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PegSpec {
    /// Radius (m).
    pub radius: f64,
    /// Height (m).
    pub height: f64,
    /// Centre of the foot (m), world axes.
    #[serde(deserialize_with = "exactly")]
    pub position: [f64; 3],
}

/// A plane through the point at `height` on the up axis: horizontal, then rotated by extrinsic x-y-z angles.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// Height along the up axis (m).
    pub height: f64,
    /// Rotation angles (rad), `R = Rz Ry Rx`.
    #[serde(deserialize_with = "exactly")]
    pub angles: [f64; 3],
}
