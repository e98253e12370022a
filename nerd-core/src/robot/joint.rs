//! One-DoF joints and what acts at them.

use nalgebra::{Isometry3, Matrix3, Unit, Vector3};

/// Kind of a one-DoF joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis within limits (rad).
    Revolute,
    /// Turns about its axis without end (rad).
    Continuous,
    /// Slides along its axis within limits (m).
    Prismatic,
}

/// Position limit acted on by a spring and a damper once violated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Lower end (rad or m).
    pub lower: f64,
    /// Upper end (rad or m).
    pub upper: f64,
    /// Stiffness beyond an end (N m/rad or N/m); 0 leaves the limit without effect.
    pub stiffness: f64,
    /// Damping beyond an end (N m s/rad or N s/m).
    pub damping: f64,
}

impl Limit {
    /// Force of the violated limit at position `q`, velocity `qd`; zero inside.
    #[inline]
    pub fn force(&self, q: f64, qd: f64) -> f64 {
        let end = q.clamp(self.lower, self.upper);
        if end == q { 0.0 } else { self.stiffness * (end - q) - self.damping * qd }
    }
}

/// How a joint follows a coordinate: `position = multiplier q + offset`, exactly and at all times. It has no coordinate of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mimic {
    /// Index of the coordinate among the joints' coordinates, `0..joint_count`.
    pub coordinate: usize,
    /// rad or m per unit of the coordinate.
    pub multiplier: f64,
    /// Its position at a coordinate of zero (rad or m).
    pub offset: f64,
}

/// A one-DoF joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name from the URDF.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// The coordinate it follows, if it does not move by itself. Its own limit, spring, damping and friction then have no effect: reading a
    /// URDF narrows the limit of the leading joint, and adds damping and friction to it.
    pub(super) mimic: Option<Mimic>,
    /// Position limit, if any.
    pub limit: Option<Limit>,
    /// Viscous damping (N m s/rad or N s/m).
    pub damping: f64,
    /// Dry friction (N m or N): its size while the joint slips, and the largest load it holds while the joint sticks.
    pub friction: f64,
    /// Stiffness of a spring at the joint (N m/rad or N/m), always active, such as the bending stiffness of a cable; 0: none.
    pub stiffness: f64,
    /// Rest position of that spring (rad or m).
    pub rest: f64,
    /// Inertia of the drive seen at the joint (kg m^2 or kg).
    pub armature: f64,
    /// Largest effort (N m or N); infinite where none is given. Drives (`nerd_sim::drive`) keep it; torques given directly do not.
    pub effort: f64,
    /// Largest velocity (rad/s or m/s); infinite where none is given. Drives keep it; torques given directly do not.
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

    /// Puts the joint frame at another pose in the parent link's frame.
    pub fn set_origin(&mut self, origin: Isometry3<f64>) {
        self.turn = turn(&origin, &self.axis);
        self.origin = origin;
    }

    /// `R_origin (a a^T)`, `R_origin [a]x`, `R_origin (1 - a a^T)`: rotation = 1st + 2nd sin q + 3rd cos q.
    #[inline]
    pub fn turn(&self) -> &[Matrix3<f64>; 3] {
        &self.turn
    }

    /// The coordinate it follows, if it does not move by itself; set by [`super::Robot::follow`].
    #[inline]
    pub fn mimic(&self) -> Option<&Mimic> {
        self.mimic.as_ref()
    }

    /// Derivative of its position with respect to its coordinate: 1 unless the joint follows another.
    #[inline]
    pub fn ratio(&self) -> f64 {
        self.mimic.map_or(1.0, |m| m.multiplier)
    }

    /// Whether the coordinate is an angle kept in [-pi, pi), that is, whether it turns without limits. A joint with limits, however wide,
    /// counts its turns, and so does one with a spring.
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
