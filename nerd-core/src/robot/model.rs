//! Links, and the robot that they form. Bodies on fixed joints are lumped into the link that carries them. Every link
//! except a floating root is carried by one moving joint.
//!
//! Dimensions: with `k` independent one-DoF joints a fixed-base robot has `nq = nv = k`; a floating one `nq = 7 + k`,
//! `nv = 6 + k`. Coordinates: `q = [p (3), quaternion x y z w (4),] joints`, `qd = [w (3), v (3),] joints`, where
//! `(w, v)` is the root's spatial twist in world axes about the world's origin: `v = p_dot + p x w`
//! ([`crate::velocity`]).

use super::{Mimic, ShapeKind};
use crate::prelude::*;

/// The root link's base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Base {
    /// Fixed to the world at this pose; [`Base::fixed`] gives a base at the world's origin.
    Fixed(Isometry3<f64>),
    /// Free to move: link 0 is the root and has no joint.
    Floating,
}

impl Base {
    /// A base fixed at the world's origin, in the world's axes.
    pub fn fixed() -> Self {
        Self::Fixed(Isometry3::identity())
    }
}

/// One rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Name of the link's body in the robot's file.
    pub name: String,
    /// Index of the parent link; `None` for links on the fixed base and for a floating root.
    pub parent: Option<usize>,
    /// The joint that carries the link; `None` only for a floating root.
    pub joint: Option<Joint>,
    /// Inertia in the link frame, including the bodies fixed to the link.
    pub inertia: BodyInertia,
    /// Gravity-compensated part of the mass, as one point mass in the link frame. Gravity does not act on this part.
    pub lifted: PointMass,
    /// Collision shapes, including those of bodies fixed to the link.
    pub shapes: Vec<Shape>,
    /// Pose of the file's body frame in the link frame. Positions given with the body's name are in the body frame
    /// ([`Robot::frame`]). The pose is the identity, except for an MJCF body whose joint is not at the body's origin.
    pub frame: Isometry3<f64>,
}

impl Link {
    /// A link without shapes, with its body frame at the link frame.
    pub fn new(name: impl Into<String>, parent: Option<usize>, joint: Option<Joint>, inertia: BodyInertia) -> Self {
        Self {
            name: name.into(),
            parent,
            joint,
            inertia,
            lifted: PointMass::default(),
            shapes: Vec::new(),
            frame: Isometry3::identity(),
        }
    }
}

impl Link {
    /// Adds `armature` (kg m^2 and kg) to the inertia of each DoF of a floating root, without weight. A negative number
    /// removes armature.
    pub fn arm(&mut self, armature: f64) {
        let own =
            BodyInertia { mass: armature, com: Vector3::zeros(), inertia: Matrix3::from_diagonal_element(armature) };
        self.inertia = self.inertia.welded(&own);
        self.lifted = self.lifted.with(&PointMass { mass: armature, at: Vector3::zeros() });
    }
}

/// A frame fixed on a moving link.
#[derive(Clone, Debug, PartialEq)]
pub struct FixedFrame {
    /// Name of the body in the file.
    pub name: String,
    /// Index of the moving link that carries the frame; `None` on a fixed base.
    pub link: Option<usize>,
    /// Pose in the frame of the link, or of the base if `link` is `None`.
    pub pose: Isometry3<f64>,
}

/// Armature and damping of a floating root, each the same on all six DoFs. The DoFs are three rotations and three
/// translations of the root link's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FreeRoot {
    /// Inertia without weight (kg m^2 for rotations, kg for translations). The inertia of link 0 includes this
    /// armature, and the link's compensated mass cancels the weight of the armature.
    pub armature: f64,
    /// Viscous damping (N m s/rad for rotations, N s/m for translations).
    pub damping: f64,
}

/// A robot model. Links are in topological order: a parent comes before its children.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Name of the robot in its file.
    pub name: String,
    /// The base.
    pub base: Base,
    /// Moving links.
    pub links: Vec<Link>,
    /// Armature and damping of a floating root.
    pub free: FreeRoot,
    /// Candidate contact points.
    pub contact_points: Vec<ContactPoint>,
    /// Frames of bodies on fixed joints (sole, IMU, tool).
    pub frames: Vec<FixedFrame>,
    /// Number of mimic joints; stored, since every step needs `nq` and `nv`.
    followers: usize,
}

impl Robot {
    /// A robot without links.
    pub fn new(name: impl Into<String>, base: Base) -> Self {
        let free = FreeRoot::default();
        Self {
            name: name.into(),
            base,
            links: Vec::new(),
            free,
            contact_points: Vec::new(),
            frames: Vec::new(),
            followers: 0,
        }
    }

    /// Makes the joint of link `link` a mimic joint, or independent again if `mimic` is `None`. The law's coordinate
    /// counts the joints that are independent after all calls.
    pub fn follow(&mut self, link: usize, mimic: Option<Mimic>) {
        if let Some(joint) = &mut self.links[link].joint {
            joint.mimic = mimic;
        }
        self.followers = self.links.iter().filter(|l| l.joint.as_ref().is_some_and(|j| j.mimic.is_some())).count();
    }

    /// Whether the root is floating.
    #[inline]
    pub fn floating(&self) -> bool {
        self.base == Base::Floating
    }

    /// DoFs of the root: 6 if floating, else 0. [`Robot::dofs`] gives the DoF of a link's joint.
    #[inline]
    pub fn root_dofs(&self) -> usize {
        if self.floating() { 6 } else { 0 }
    }

    /// Coordinates of the root in `q`: 7 if floating, else 0.
    #[inline]
    pub fn root_coords(&self) -> usize {
        if self.floating() { 7 } else { 0 }
    }

    /// Number of independent one-DoF joints.
    #[inline]
    pub fn joint_count(&self) -> usize {
        self.links.len() - usize::from(self.floating()) - self.followers
    }

    /// Whether the robot has mimic joints.
    #[inline]
    pub fn mimics(&self) -> bool {
        self.followers > 0
    }

    /// The first mimic joint, if any.
    pub fn follower(&self) -> Option<&Joint> {
        self.links.iter().filter_map(|l| l.joint.as_ref()).find(|j| j.mimic.is_some())
    }

    /// The index in `qd` of each link's joint, `[link]`. Mimic joints share the index of their leader. A floating root
    /// has index 0, the first of its six DoFs.
    pub fn dofs(&self) -> Vec<usize> {
        let first = self.root_dofs();
        let mut own = 0;
        let of = |link: &Link| match &link.joint {
            None => 0,
            Some(Joint { mimic: Some(mimic), .. }) => first + mimic.coordinate,
            Some(_) => {
                own += 1;
                first + own - 1
            }
        };
        self.links.iter().map(of).collect()
    }

    /// Length of `q`.
    #[inline]
    pub fn nq(&self) -> usize {
        self.root_coords() + self.joint_count()
    }

    /// Length of `qd` and `tau`, and the size of the mass matrix.
    #[inline]
    pub fn nv(&self) -> usize {
        self.root_dofs() + self.joint_count()
    }

    /// Length of a state `[q, qd]`.
    #[inline]
    pub fn state_dim(&self) -> usize {
        self.nq() + self.nv()
    }

    /// Zero coordinates `q[nq]`, with the unit quaternion of a floating root.
    pub fn neutral(&self) -> Vec<f64> {
        let mut q = self.zero_state();
        q.truncate(self.nq());
        q
    }

    /// Zero state `[q, qd]`, with the unit quaternion of a floating root.
    pub fn zero_state(&self) -> Vec<f64> {
        let mut state = vec![0.0; self.state_dim()];
        if self.floating() {
            state[6] = 1.0;
        }
        state
    }

    /// A link and its ancestors, from the link to the root.
    #[inline]
    pub fn ancestors(&self, link: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(link), |i| self.links[*i].parent)
    }

    /// The independent one-DoF joints, in the order of their coordinates.
    #[inline]
    pub fn joints(&self) -> impl Iterator<Item = &Joint> {
        self.links.iter().filter_map(|l| l.joint.as_ref()).filter(|j| j.mimic.is_none())
    }

    /// Like `Self::joints`, but mutable, to set armature, damping or limits.
    pub fn joints_mut(&mut self) -> impl Iterator<Item = &mut Joint> {
        self.links.iter_mut().filter_map(|l| l.joint.as_mut()).filter(|j| j.mimic.is_none())
    }

    /// Whether some joint has dry friction.
    #[inline]
    pub fn dry(&self) -> bool {
        self.joints().any(|j| j.friction > 0.0)
    }

    /// Whether some joint has a spring.
    #[inline]
    pub fn sprung(&self) -> bool {
        self.joints().any(|j| j.stiffness > 0.0)
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

    /// Collision geometry of a link for an engine with shapes. A box or cylinder is given as a shape if all its contact
    /// points are in use. The remaining contact points are given as balls. A box's corners as balls of 1e-5 m would
    /// catch on the ground: a sliding plate stops within a frame.
    pub fn touching(&self, link: usize) -> (Vec<Shape>, Vec<ContactPoint>) {
        let mut points: Vec<_> = self.contact_points.iter().filter(|p| p.link == link).cloned().collect();
        let mut shapes = Vec::new();
        let angular = |s: &&Shape| matches!(s.kind, ShapeKind::Box { .. } | ShapeKind::Cylinder { .. });
        for shape in self.links[link].shapes.iter().filter(angular) {
            let own = shape.contact_points(link);
            if own.iter().all(|c| points.contains(c)) {
                points.retain(|p| !own.contains(p));
                shapes.push(shape.clone());
            }
        }
        // Of a disc's three contact points, the one with `turn = 0` stands for the whole disc.
        points.retain(|p| !matches!(p.locus, Locus::Rim { turn, .. } if turn != 0.0));
        (shapes, points)
    }
}
