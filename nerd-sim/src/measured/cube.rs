//! The tossed cube, and how its published restitution becomes a damper.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use crate::bodies::Body;
use crate::system::{System, SystemError};

/// Published edge (m).
pub const EDGE: f64 = 0.1048;
/// Published mass (kg).
pub const MASS: f64 = 0.37;
/// Published inertia about each axis (kg m^2).
pub const INERTIA: f64 = 8.1e-4;
/// Inertia of a solid cube of that mass (kg m^2).
pub const SOLID: f64 = MASS * EDGE * EDGE / 6.0;
/// Published friction coefficient.
pub const FRICTION: f64 = 0.18;
/// Published restitution.
pub const RESTITUTION: f64 = 0.125;

/// The published cube on a compliant table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cube {
    /// Normal stiffness (N/m).
    pub stiffness: f64,
    /// Restitution that the damper is to give one corner's landing.
    pub restitution: f64,
    /// Tangential damping below the cone (N s/m).
    pub friction_damping: f64,
    /// Friction coefficient.
    pub friction: f64,
    /// Inertia about each axis (kg m^2).
    pub inertia: f64,
}

impl Default for Cube {
    /// Nobody published a stiffness: this is the softest power of ten on which the cube sinks less than 0.1 mm at rest. With 200
    /// N s/m a resting corner slips less than 1 mm/s before the cone holds it.
    fn default() -> Self {
        Self { stiffness: 1e4, restitution: RESTITUTION, friction_damping: 200.0, friction: FRICTION, inertia: INERTIA }
    }
}

impl Cube {
    /// Its system, of 1/148 s a frame; the table is scene `ground`.
    ///
    /// # Errors
    /// [`SystemError`] where a field cannot be honoured, such as a negative stiffness.
    pub fn system(&self) -> Result<Arc<System>, SystemError> {
        Body {
            shape: format!(r#"<box size="{EDGE} {EDGE} {EDGE}"/>"#),
            mass: MASS,
            inertia: [self.inertia; 3],
            frame: "1/148",
            material: [self.stiffness, self.damping(), self.friction_damping, self.friction],
            ..Default::default()
        }
        .system()
    }

    /// Damping (N s/m) at which the law throws a corner back with `restitution` of its speed.
    pub fn damping(&self) -> f64 {
        let (mut low, mut high) = (0.0f64, 1e3);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if rebound(middle) > self.restitution { low = middle } else { high = middle }
        }
        2.0 * low * (self.stiffness * landing_mass()).sqrt()
    }
}

/// Speed after a landing over speed before it, at damping ratio `zeta`: damped on the way in, undamped on the way out.
fn rebound(zeta: f64) -> f64 {
    let gap = 1.0 - zeta * zeta;
    let way = if gap > 1e-9 {
        zeta * zeta.acos() / gap.sqrt()
    } else if gap < -1e-9 {
        zeta * zeta.acosh() / (-gap).sqrt()
    } else {
        1.0
    };
    (-way).exp()
}

/// Mass that the lowest corner shows the table, `1 / (1/m + |r x n|^2 / I)` with the mean of `|r x n|^2` over all
/// orientations: `h^2 (3 - E (|n1| + |n2| + |n3|)^2) = h^2 (2 - 4 / pi)` for the half edge h.
fn landing_mass() -> f64 {
    let arm = 0.25 * EDGE * EDGE * (2.0 - 4.0 / std::f64::consts::PI);
    1.0 / (1.0 / MASS + arm / INERTIA)
}

/// Height of the lowest corner (m).
pub fn lowest(pose: &Isometry3<f64>) -> f64 {
    let up = pose.rotation.inverse() * Vector3::z();
    pose.translation.vector.z - 0.5 * EDGE * up.iter().map(|x| x.abs()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prelude::*;

    /// A ball with the mass a corner shows, dropped on the table, against the restitution asked for.
    #[test]
    fn the_damper_gives_the_restitution_asked_for() {
        for restitution in [RESTITUTION, 0.5] {
            let cube = Cube { restitution, ..Default::default() };
            let body = Body {
                shape: r#"<sphere radius="0.05"/>"#.into(),
                mass: landing_mass(),
                frame: "1/1000",
                gravity: 1e-6,
                material: [cube.stiffness, cube.damping(), 0.0, 0.0],
                ..Default::default()
            };
            let system = body.system().expect("a ball");
            let mut batch = Batch::new(&system, &system.scene("ground").expect("ground"), 1);
            batch.reset(0, &Body::state([0.0, 0.0, 0.051], [0.0, 0.0, 0.0, 1.0], [0.0; 3], [0.0, 0.0, -1.0]));
            let mut solver = Articulated::new(ArticulatedConfig::converged(Friction::Coulomb));
            for _ in 0..100 {
                solver.step(&mut batch, &[]).expect("a frame");
            }
            let speed = batch.state(0)[12];
            assert!((speed - restitution).abs() < 1e-3, "thrown back at {speed} m/s of 1, {restitution} asked for");
        }
    }

    #[test]
    fn the_lowest_corner_of_a_cube_on_its_edge_and_its_corner() {
        let at = |roll: f64, pitch: f64| {
            let turn = nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, 0.3);
            lowest(&Isometry3::from_parts(Vector3::new(1.0, 2.0, 0.5).into(), turn))
        };
        let quarter = std::f64::consts::FRAC_PI_4;
        assert!((at(0.0, 0.0) - (0.5 - 0.0524)).abs() < 1e-12);
        assert!((at(quarter, 0.0) - (0.5 - 0.0524 * 2f64.sqrt())).abs() < 1e-12);
        assert!((at(quarter, (1.0 / 2f64.sqrt()).atan()) - (0.5 - 0.0524 * 3f64.sqrt())).abs() < 1e-12);
    }
}
