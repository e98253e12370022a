//! One-DoF joints and the numbers of their forces. Solvers compute the forces (`nerd_sim::articulated`); a limit's is
//! here.

use nalgebra::{Isometry3, Matrix3, Unit, Vector3};

/// Type of a one-DoF joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Hinge with limits (rad).
    Revolute,
    /// Hinge without limits (rad).
    Continuous,
    /// Slide with limits (m).
    Prismatic,
}

/// Position limit, enforced by a spring and a damper where it is exceeded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Lower end (rad or m).
    pub lower: f64,
    /// Upper end (rad or m).
    pub upper: f64,
    /// Stiffness beyond a limit (N m/rad or N/m); 0 leaves the limit without effect.
    pub stiffness: f64,
    /// Damping beyond a limit (N m s/rad or N s/m).
    pub damping: f64,
}

impl Limit {
    /// Force (N m or N) at position `q` and velocity `qd`; zero within the limits.
    #[inline]
    pub fn force(&self, q: f64, qd: f64) -> f64 {
        let end = q.clamp(self.lower, self.upper);
        if end == q { 0.0 } else { self.stiffness * (end - q) - self.damping * qd }
    }
}

/// Law of a mimic joint: `position = multiplier q + offset`, exact at all times. A mimic joint adds no coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mimic {
    /// Index of q among the coordinates of the joints, `0..joint_count`.
    pub coordinate: usize,
    /// rad or m per unit of the coordinate.
    pub multiplier: f64,
    /// Position at q = 0 (rad or m).
    pub offset: f64,
}

/// A one-DoF joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name from the URDF.
    pub name: String,
    /// Type of motion.
    pub kind: JointKind,
    /// The coordinate that a mimic joint follows. Its limit, spring, damping and friction then have no effect: reading
    /// a URDF narrows the limit of the leading joint, and adds damping and friction to it.
    pub(super) mimic: Option<Mimic>,
    /// Position limit, if any.
    pub limit: Option<Limit>,
    /// Viscous damping (N m s/rad or N s/m).
    pub damping: f64,
    /// Dry friction (N m or N): its magnitude in slip, and the largest load it holds in stick.
    pub friction: f64,
    /// Stiffness of a spring at the joint (N m/rad or N/m), such as the bending stiffness of a cable; 0: no spring.
    pub stiffness: f64,
    /// Position of that spring at zero force (rad or m).
    pub rest: f64,
    /// Armature: inertia of the drive seen at the joint (kg m^2 or kg).
    pub armature: f64,
    /// Largest effort (N m or N); infinite if the file gives none. Drives (`nerd_sim::drive`) obey it; torques given
    /// directly do not.
    pub effort: f64,
    /// Largest velocity (rad/s or m/s); infinite if the file gives none. Drives obey it; torques given directly do not.
    pub velocity: f64,
    origin: Isometry3<f64>,
    axis: Unit<Vector3<f64>>,
    turn: [Matrix3<f64>; 3],
}

impl Joint {
    /// A joint without limit, damping, friction or armature.
    pub fn new(name: impl Into<String>, kind: JointKind, origin: Isometry3<f64>, axis: Unit<Vector3<f64>>) -> Self {
        let free = f64::INFINITY;
        Self {
            name: name.into(),
            kind,
            mimic: None,
            limit: None,
            damping: 0.0,
            friction: 0.0,
            stiffness: 0.0,
            rest: 0.0,
            armature: 0.0,
            effort: free,
            velocity: free,
            turn: turn(&origin, &axis),
            origin,
            axis,
        }
    }

    /// Pose of the joint frame in the parent link's frame.
    #[inline]
    pub fn origin(&self) -> &Isometry3<f64> {
        &self.origin
    }

    /// Axis in the joint frame.
    #[inline]
    pub fn axis(&self) -> &Unit<Vector3<f64>> {
        &self.axis
    }

    /// Sets the pose of the joint frame in the parent link's frame.
    pub fn set_origin(&mut self, origin: Isometry3<f64>) {
        self.turn = turn(&origin, &self.axis);
        self.origin = origin;
    }

    /// `R_origin (a a^T)`, `R_origin [a]x`, `R_origin (1 - a a^T)`: rotation = 1st + 2nd sin q + 3rd cos q.
    #[inline]
    pub fn turn(&self) -> &[Matrix3<f64>; 3] {
        &self.turn
    }

    /// The coordinate that a mimic joint follows; set by [`super::Robot::follow`].
    #[inline]
    pub fn mimic(&self) -> Option<&Mimic> {
        self.mimic.as_ref()
    }

    /// Derivative of the position with respect to its coordinate: the multiplier of a mimic joint, else 1.
    #[inline]
    pub fn ratio(&self) -> f64 {
        self.mimic.map_or(1.0, |m| m.multiplier)
    }

    /// Whether the coordinate is an angle kept in [-pi, pi): a hinge without limits and spring. With limits, however
    /// wide, or a spring, full turns count.
    #[inline]
    pub fn wraps(&self) -> bool {
        self.kind != JointKind::Prismatic && self.limit.is_none() && self.stiffness == 0.0
    }
}

/// See [`Joint::turn`]; recomputed whenever the origin or the axis changes.
fn turn(origin: &Isometry3<f64>, axis: &Unit<Vector3<f64>>) -> [Matrix3<f64>; 3] {
    let r = origin.rotation.to_rotation_matrix();
    let aa = axis.into_inner() * axis.transpose();
    [r.matrix() * aa, r.matrix() * axis.cross_matrix(), r.matrix() * (Matrix3::identity() - aa)]
}
