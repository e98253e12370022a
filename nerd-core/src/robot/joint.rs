//! One-DoF joints: geometry, limits, and coefficients of springs, damping and friction. Solvers compute these forces
//! (`nerd_sim::articulated`); [`Limit::force`] gives the force of a limit.

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

/// Position limit of a joint. Beyond the limit a spring and a damper push the joint back.
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
    /// Force of the limit (N m or N) at position `q` (rad or m) and velocity `qd` (rad/s or m/s); zero within the
    /// limits.
    #[inline]
    pub fn force(&self, q: f64, qd: f64) -> f64 {
        let end = q.clamp(self.lower, self.upper);
        if end == q { 0.0 } else { self.stiffness * (end - q) - self.damping * qd }
    }
}

/// Law of a mimic joint: `position = multiplier q + offset`, with q the coordinate of the leading joint. The law holds
/// exactly at all times, so a mimic joint adds no coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mimic {
    /// Index of q among the coordinates of the joints, `0..joint_count`.
    pub coordinate: usize,
    /// Change of the mimic joint's position (rad or m) per unit of q (rad or m).
    pub multiplier: f64,
    /// Position of the mimic joint at q = 0 (rad or m).
    pub offset: f64,
}

/// A one-DoF joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name from the URDF.
    pub name: String,
    /// Type of motion.
    pub kind: JointKind,
    /// For a mimic joint, the law by which it follows a coordinate. The limit, spring, damping and friction of a mimic
    /// joint have no effect. Reading a URDF narrows the limit of the leading joint instead, and adds damping and
    /// friction to the leading joint.
    pub(super) mimic: Option<Mimic>,
    /// Position limit, if any.
    pub limit: Option<Limit>,
    /// Viscous damping (N m s/rad or N s/m).
    pub damping: f64,
    /// Dry friction (N m or N): magnitude of its force in slip, and the largest load that it holds in stick.
    pub friction: f64,
    /// Stiffness of a spring at the joint (N m/rad or N/m), such as the bending stiffness of a cable; 0: no spring.
    pub stiffness: f64,
    /// Position (rad or m) at which the joint's spring has zero force.
    pub rest: f64,
    /// Armature: inertia of the drive seen at the joint (kg m^2 or kg).
    pub armature: f64,
    /// Largest effort (N m or N); infinite if the file gives none. It limits drives (`nerd_sim::drive`), but not
    /// torques given directly.
    pub effort: f64,
    /// Largest velocity (rad/s or m/s); infinite if the file gives none. It limits drives, but not torques given
    /// directly.
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

    /// Three matrices `R_origin (a a^T)`, `R_origin [a]x` and `R_origin (1 - a a^T)`, with a the axis. The joint's
    /// rotation at angle q is the first, plus sin q times the second, plus cos q times the third.
    #[inline]
    pub fn turn(&self) -> &[Matrix3<f64>; 3] {
        &self.turn
    }

    /// The coordinate that a mimic joint follows; set by [`super::Robot::follow`].
    #[inline]
    pub fn mimic(&self) -> Option<&Mimic> {
        self.mimic.as_ref()
    }

    /// Derivative of the joint's position with respect to the coordinate that moves it: the multiplier of a mimic
    /// joint, else 1.
    #[inline]
    pub fn ratio(&self) -> f64 {
        self.mimic.map_or(1.0, |m| m.multiplier)
    }

    /// Whether the coordinate is an angle kept in [-pi, pi): so for a hinge with neither limits nor a spring. With
    /// limits, however wide, or with a spring, the angle counts full turns.
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
