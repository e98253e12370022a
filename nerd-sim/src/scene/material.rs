//! Contact materials.

use serde::{Deserialize, Serialize};

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
}

impl Default for Material {
    /// The reference simulator's plane, 1e5 N/m, 1e3 N s/m, 0.5, but 1e5 N s/m against slip where that has 1e3: a foot that
    /// 30 N push aside, as a standing quadruped's own legs do, creeps by 0.3 mm/s in place of 30.
    fn default() -> Self {
        Self { stiffness: 1e5, damping: 1e3, friction_damping: 1e5, friction: 0.5 }
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
        }
    }

    /// Whether [`Self::check`] has nothing to say.
    #[inline]
    pub(crate) fn sound(&self) -> bool {
        let fits = |x: f64| (0.0..=MOST).contains(&x);
        fits(self.stiffness) && fits(self.damping) && fits(self.friction_damping) && (0.0..=MOST_FRICTION).contains(&self.friction)
    }

    /// Says which number is out of its range, if one is.
    pub fn check(&self) -> Result<(), String> {
        for (key, value, unit, most) in [
            ("stiffness", self.stiffness, " N/m", MOST),
            ("damping", self.damping, " N s/m", MOST),
            ("friction_damping", self.friction_damping, " N s/m", MOST),
            ("friction", self.friction, "", MOST_FRICTION),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(format!("`{key}` is {value}{unit}, a number from 0 to {most:e}{unit} is needed"));
            }
        }
        Ok(())
    }
}
