//! Scenes and contact materials in a robot's TOML.

use super::TerrainSpec;
use crate::{internal::*, range::exactly};

/// Largest stiffness (N/m) and damping (N s/m).
const MOST: f64 = 1e12;
/// Largest friction coefficient.
const MOST_FRICTION: f64 = 1e6;

/// Compliant contact material; a pair acts with the mean of its two.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Normal stiffness k_e (N/m).
    pub stiffness: f64,
    /// Normal damping k_d (N s/m), while approaching.
    pub damping: f64,
    /// Tangential damping k_f (N s/m).
    pub friction_damping: f64,
    /// Friction coefficient mu.
    pub friction: f64,
    /// Torsional friction (m): largest torque about the normal over the normal force.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub torsion: f64,
    /// Rolling friction (m): largest torque across the normal over the normal force.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rolling: f64,
    /// Distance (m) at which the force begins.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub margin: f64,
    /// Time (s) in which a point inside comes out: while it parts the damping is the stiffness times this. 0 as in the reference simulator:
    /// what starts inside of the ground is thrown.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub release: f64,
}

/// Zero is the default, and is not written.
pub(crate) fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl Default for Material {
    /// The reference simulator's plane, 1e5 N/m, 1e3 N s/m, 0.5, but 1e5 N s/m against slip where that has 1e3: a foot that
    /// 30 N push aside, as a standing quadruped's own legs do, creeps by 0.3 mm/s in place of 30.
    fn default() -> Self {
        Self { stiffness: 1e5, damping: 1e3, friction_damping: 1e5, friction: 0.5, torsion: 0.0, rolling: 0.0, margin: 0.0, release: 0.0 }
    }
}

impl Material {
    /// Material of a pair.
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

    /// Damping (N s/m) at a velocity along the normal.
    #[inline]
    pub(crate) fn damper(&self, vn: f64) -> f64 {
        if vn < 0.0 { self.damping } else { self.stiffness * self.release }
    }

    /// Says which number is out of its range, if one is.
    pub fn check(&self) -> Result<(), String> {
        within("`stiffness`", self.stiffness, 0.0..=MOST, "N/m")?;
        within("`damping`", self.damping, 0.0..=MOST, "N s/m")?;
        within("`friction_damping`", self.friction_damping, 0.0..=MOST, "N s/m")?;
        within("`friction`", self.friction, 0.0..=MOST_FRICTION, "")?;
        within("`torsion`", self.torsion, 0.0..=MOST_FRICTION, "m")?;
        within("`rolling`", self.rolling, 0.0..=MOST_FRICTION, "m")?;
        within("`margin`", self.margin, -1.0..=1.0, "m")?;
        within("`release`", self.release, 0.0..=1.0, "s")
    }
}

/// A named scene.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Its name on the command line.
    pub name: String,
    /// Its plane.
    pub plane: PlaneSpec,
    /// Ground in place of the plane, with its heights from there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terrain: Option<TerrainSpec>,
    /// Boxes on it.
    #[serde(default, rename = "box", skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<BoxSpec>,
    /// Pegs on it: upright cylinders.
    #[serde(default, rename = "peg", skip_serializing_if = "Vec::is_empty")]
    pub pegs: Vec<PegSpec>,
    /// Its material [default: the robot's].
    pub material: Option<Material>,
}

/// A box, its third edge along the up axis.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BoxSpec {
    /// Its edges (m).
    #[serde(deserialize_with = "exactly")]
    pub size: [f64; 3],
    /// Its centre (m), world axes.
    #[serde(deserialize_with = "exactly")]
    pub at: [f64; 3],
    /// Turn about the up axis (rad).
    #[serde(default)]
    pub turn: f64,
}

/// A cylinder along the up axis.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PegSpec {
    /// Its radius (m).
    pub radius: f64,
    /// Its height (m).
    pub height: f64,
    /// The middle of its foot (m), world axes.
    #[serde(deserialize_with = "exactly")]
    pub at: [f64; 3],
}

/// A plane through (0, height, 0): the horizontal one turned by extrinsic x-y-z angles.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// Height along the up axis (m).
    pub height: f64,
    /// Angles (rad), `R = Rz Ry Rx`.
    #[serde(deserialize_with = "exactly")]
    pub angles: [f64; 3],
}
