//! Links, joints, shapes. Fixed joints are lumped away; every link but a floating root hangs on one moving joint.
//!
//! Dimensions: with `k` one-DoF joints a fixed-base robot has `nq = nv = k`; a floating one `nq = 7 + k`,
//! `nv = 6 + k`. Coordinates: `q = [p (3), quaternion x y z w (4),] joints`, `qd = [w (3), v (3),] joints`, where
//! `(w, v)` is the root's spatial twist in world axes about the world origin: `v = p_dot + p x w`.

use nalgebra::{Isometry3, Matrix3, Unit, Vector3};

use crate::contact::ContactPoint;
use crate::spatial::BodyInertia;

/// What the root link stands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Base {
    /// Bolted to the world at this pose.
    Fixed(Isometry3<f64>),
    /// Free to move: link 0 is the root and has no joint.
    Floating,
}

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

/// A one-DoF joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name from the URDF.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Pose of the joint frame in the parent link's frame.
    pub origin: Isometry3<f64>,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Position limit, if any.
    pub limit: Option<Limit>,
    /// Viscous damping (N m s/rad or N s/m).
    pub damping: f64,
    /// Dry friction (N m or N): its size while the joint slips, and what it holds at most.
    pub friction: f64,
    /// Inertia of the drive seen at the joint (kg m^2 or kg).
    pub armature: f64,
    /// Largest effort (N m or N); infinite where none is given. Not enforced by solvers.
    pub effort: f64,
    /// Largest velocity (rad/s or m/s); infinite where none is given. Not enforced by solvers.
    pub velocity: f64,
    /// `R_origin (a a^T)`, `R_origin [a]x`, `R_origin (1 - a a^T)`: rotation = 1st + 2nd sin q + 3rd cos q.
    pub(crate) turn: [Matrix3<f64>; 3],
}

impl Joint {
    /// A joint without limit, damping, friction or armature.
    pub fn new(name: impl Into<String>, kind: JointKind, origin: Isometry3<f64>, axis: Unit<Vector3<f64>>) -> Self {
        let r = origin.rotation.to_rotation_matrix();
        let aa = axis.into_inner() * axis.transpose();
        let turn = [r.matrix() * aa, r.matrix() * axis.cross_matrix(), r.matrix() * (Matrix3::identity() - aa)];
        let free = f64::INFINITY;
        Self {
            name: name.into(),
            kind,
            origin,
            axis,
            limit: None,
            damping: 0.0,
            friction: 0.0,
            armature: 0.0,
            effort: free,
            velocity: free,
            turn,
        }
    }

    /// Whether the coordinate is an angle kept in [-pi, pi): no limit, or one wider than a turn.
    pub fn wraps(&self) -> bool {
        match self.kind {
            JointKind::Prismatic => false,
            JointKind::Continuous => true,
            JointKind::Revolute => self.limit.is_none_or(|l| l.upper - l.lower > std::f64::consts::TAU),
        }
    }
}

/// A primitive collision shape fixed on a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Its pose in the link frame.
    pub pose: Isometry3<f64>,
    /// What it is.
    pub kind: ShapeKind,
}

impl Shape {
    /// Points that stand for this shape on link `link`: a sphere's centre, the ends of a capsule's or cylinder's axis (the
    /// far one along +z first), a box's corners (x fastest, negative first; radius 1e-5 m).
    pub fn contact_points(&self, link: usize) -> Vec<ContactPoint> {
        let point = |local: Vector3<f64>, radius: f64| {
            let local = self.pose.transform_point(&local.into()).coords;
            ContactPoint { link, local, radius, thickness: radius }
        };
        match self.kind {
            ShapeKind::Sphere { radius } => vec![point(Vector3::zeros(), radius)],
            ShapeKind::Capsule { radius, half_length } | ShapeKind::Cylinder { radius, half_length } => {
                [half_length, -half_length].map(|z| point(Vector3::z() * z, radius)).into()
            }
            ShapeKind::Box { half } => {
                let side = |corner: usize, bit: usize| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
                (0..8).map(|c| point(half.component_mul(&Vector3::new(side(c, 0), side(c, 1), side(c, 2))), 1e-5)).collect()
            }
        }
    }
}

/// A box by its pose in the link frame and its half edges (m).
pub type PlacedBox = (Isometry3<f64>, Vector3<f64>);

/// Primitive shapes; lengths in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShapeKind {
    /// Ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// Box, centred.
    Box {
        /// Half edges.
        half: Vector3<f64>,
    },
    /// Cylinder along local z, centred.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half length.
        half_length: f64,
    },
    /// Capsule along local z, centred.
    Capsule {
        /// Radius.
        radius: f64,
        /// Half length of the straight part.
        half_length: f64,
    },
}

/// One rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Name from the URDF.
    pub name: String,
    /// Index of the link it hangs on; `None` for links on the fixed base and for a floating root.
    pub parent: Option<usize>,
    /// The joint it hangs on; `None` only for a floating root.
    pub joint: Option<Joint>,
    /// Inertia in the link frame, fixed children lumped in.
    pub inertia: BodyInertia,
    /// Collision shapes, fixed children's included.
    pub shapes: Vec<Shape>,
}

/// A robot model. Links are in topological order: a parent stands before its children.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Name from the URDF.
    pub name: String,
    /// What it stands on.
    pub base: Base,
    /// Its moving links.
    pub links: Vec<Link>,
    /// Points at which contact is looked for.
    pub contact_points: Vec<ContactPoint>,
    /// For each link, the link whose inertia moves in its place in the mass matrix (not in the bias). Empty, as physics has
    /// it, but for comparison with a simulator that pairs them wrongly.
    pub mass_matrix_of: Vec<usize>,
    /// Links of the URDF whose collision meshes were passed over: only primitives are looked at for contact.
    pub skipped_meshes: Vec<String>,
}

impl Robot {
    /// Whether the root is free.
    #[inline]
    pub fn floating(&self) -> bool {
        self.base == Base::Floating
    }

    /// DoF of the root: 6 if floating, else 0. The joint of link `i` has DoF index `root_dofs() + joint_index(i)`.
    #[inline]
    pub fn root_dofs(&self) -> usize {
        if self.floating() { 6 } else { 0 }
    }

    /// Coordinates of the root in `q`: 7 if floating, else 0.
    #[inline]
    pub fn root_coords(&self) -> usize {
        if self.floating() { 7 } else { 0 }
    }

    /// Number of one-DoF joints.
    #[inline]
    pub fn joint_count(&self) -> usize {
        self.links.len() - usize::from(self.floating())
    }

    /// Length of `q`.
    #[inline]
    pub fn nq(&self) -> usize {
        self.root_coords() + self.joint_count()
    }

    /// Length of `qd`, `tau` and the side of the mass matrix.
    #[inline]
    pub fn nv(&self) -> usize {
        self.root_dofs() + self.joint_count()
    }

    /// Length of a state `[q, qd]`.
    #[inline]
    pub fn state_dim(&self) -> usize {
        self.nq() + self.nv()
    }

    /// A state `[q, qd]` of zeros, with the unit quaternion of a floating root.
    pub fn zero_state(&self) -> Vec<f64> {
        let mut state = vec![0.0; self.state_dim()];
        if self.floating() {
            state[6] = 1.0;
        }
        state
    }

    /// The one-DoF joints in the order of their coordinates.
    pub fn joints(&self) -> impl Iterator<Item = &Joint> {
        self.links.iter().filter_map(|l| l.joint.as_ref())
    }

    /// The same, to be changed (armature, damping, limits).
    pub fn joints_mut(&mut self) -> impl Iterator<Item = &mut Joint> {
        self.links.iter_mut().filter_map(|l| l.joint.as_mut())
    }

    /// Whether some joint has dry friction.
    #[inline]
    pub fn dry(&self) -> bool {
        self.joints().any(|j| j.friction > 0.0)
    }

    /// Total mass (kg).
    pub fn mass(&self) -> f64 {
        self.links.iter().map(|l| l.inertia.mass).sum()
    }

    /// Contact points of all collision shapes, see [`Shape::contact_points`].
    pub fn default_contact_points(&self) -> Vec<ContactPoint> {
        let links = self.links.iter().enumerate();
        links.flat_map(|(link, body)| body.shapes.iter().flat_map(move |shape| shape.contact_points(link))).collect()
    }

    /// What a link touches a scene with, for an engine that has shapes: boxes where all eight corners
    /// are contact points, balls for the points that are left. As balls of 1e-5 m corners would catch on the ground: a
    /// sliding plate stops within a frame.
    pub fn touching(&self, link: usize) -> (Vec<PlacedBox>, Vec<ContactPoint>) {
        let mut points: Vec<_> = self.contact_points.iter().filter(|p| p.link == link).copied().collect();
        let mut boxes = Vec::new();
        for shape in &self.links[link].shapes {
            let corners = shape.contact_points(link);
            if let ShapeKind::Box { half } = shape.kind
                && corners.iter().all(|c| points.contains(c))
            {
                points.retain(|p| !corners.contains(p));
                boxes.push((shape.pose, half));
            }
        }
        (boxes, points)
    }
}
