//! Spatial (6-D) algebra in one common frame.
//!
//! **Word order: angular first, then linear.** A [`Motion`] is `(w, v)` with `v` the velocity of the body's point at
//! the frame's origin; a [`Wrench`] is `(n, f)` with `n` the moment about that origin. All vectors of one computation
//! share one frame (world axes, origin at the root, see [`crate::dynamics`]), so no transforms between links are
//! needed. Source: Featherstone, *Rigid Body Dynamics Algorithms* (2008), chapter 2, without Pluecker transforms.

use std::f64::consts::PI;
use std::ops::{Add, AddAssign, Mul, Sub};

use nalgebra::{Matrix3, Matrix6, Rotation3, UnitQuaternion, UnitVector3, Vector3, Vector6};

/// A twist (rad/s, m/s) or a spatial acceleration (rad/s^2, m/s^2): angular part, then linear part at the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Angular part.
    pub ang: Vector3<f64>,
    /// Linear part at the origin.
    pub lin: Vector3<f64>,
}

/// A wrench or a momentum: moment about the origin (N m), force (N).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Moment about the origin.
    pub ang: Vector3<f64>,
    /// Force.
    pub lin: Vector3<f64>,
}

impl Motion {
    /// The k-th unit motion, angular axes first.
    #[inline]
    pub(crate) fn unit(k: usize) -> Self {
        let mut m = Self::default();
        if k < 3 {
            m.ang = Vector3::ith(k, 1.0)
        } else {
            m.lin = Vector3::ith(k - 3, 1.0)
        }
        m
    }

    /// `self x m`: rate of change of a motion `m` fixed in a body that moves with `self`.
    #[inline]
    pub fn cross(&self, m: &Motion) -> Motion {
        Motion::new(self.ang.cross(&m.ang), self.ang.cross(&m.lin) + self.lin.cross(&m.ang))
    }

    /// `self x* f`: rate of change of a wrench `f` fixed in a body that moves with `self`.
    #[inline]
    pub fn cross_wrench(&self, f: &Wrench) -> Wrench {
        Wrench::new(self.ang.cross(&f.ang) + self.lin.cross(&f.lin), self.ang.cross(&f.lin))
    }

    /// Power `self . f` (W).
    #[inline]
    pub fn dot(&self, f: &Wrench) -> f64 {
        self.ang.dot(&f.ang) + self.lin.dot(&f.lin)
    }

    /// Velocity of the material point at `x` (m, from the origin).
    #[inline]
    pub fn at(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.lin + self.ang.cross(x)
    }
}

impl Wrench {
    /// The wrench of the force `f` at `x`.
    #[inline]
    pub fn force_at(f: Vector3<f64>, x: &Vector3<f64>) -> Self {
        Self::new(x.cross(&f), f)
    }
}

macro_rules! linear {
    ($t:ty) => {
        impl $t {
            /// From the angular and the linear part.
            #[inline]
            pub fn new(ang: Vector3<f64>, lin: Vector3<f64>) -> Self {
                Self { ang, lin }
            }

            /// Both parts in one vector.
            #[inline]
            pub fn vector(&self) -> Vector6<f64> {
                Vector6::new(self.ang.x, self.ang.y, self.ang.z, self.lin.x, self.lin.y, self.lin.z)
            }

            /// From the first six numbers of `x`.
            #[inline]
            pub fn from_slice(x: &[f64]) -> Self {
                Self::new(Vector3::new(x[0], x[1], x[2]), Vector3::new(x[3], x[4], x[5]))
            }
        }
        impl Add for $t {
            type Output = Self;
            #[inline]
            fn add(self, o: Self) -> Self {
                Self::new(self.ang + o.ang, self.lin + o.lin)
            }
        }
        impl Sub for $t {
            type Output = Self;
            #[inline]
            fn sub(self, o: Self) -> Self {
                Self::new(self.ang - o.ang, self.lin - o.lin)
            }
        }
        impl AddAssign for $t {
            #[inline]
            fn add_assign(&mut self, o: Self) {
                self.ang += o.ang;
                self.lin += o.lin;
            }
        }
        impl Mul<f64> for $t {
            type Output = Self;
            #[inline]
            fn mul(self, k: f64) -> Self {
                Self::new(self.ang * k, self.lin * k)
            }
        }
    };
}
linear!(Motion);
linear!(Wrench);

/// Inertia of a rigid body in its link frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyInertia {
    /// Mass (kg).
    pub mass: f64,
    /// Centre of mass in the link frame (m).
    pub com: Vector3<f64>,
    /// Rotational inertia about the centre of mass, link axes (kg m^2).
    pub inertia: Matrix3<f64>,
}

impl BodyInertia {
    /// The inertia in a frame in which the present link frame has pose (`rotation`, `translation`).
    pub fn transformed(&self, rotation: &Rotation3<f64>, translation: &Vector3<f64>) -> Self {
        let r = rotation.matrix();
        Self { mass: self.mass, com: r * self.com + translation, inertia: r * self.inertia * r.transpose() }
    }

    /// Two bodies welded together (parallel-axis theorem, exact).
    pub fn welded(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let com = if mass > 0.0 { (self.com * self.mass + other.com * other.mass) / mass } else { self.com };
        let about = |b: &Self| b.inertia + parallel_axis(b.mass, &(b.com - com));
        Self { mass, com, inertia: about(self) + about(other) }
    }
}

/// A point mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointMass {
    /// Mass (kg).
    pub mass: f64,
    /// Position (m).
    pub at: Vector3<f64>,
}

impl PointMass {
    /// Merges two point masses: their sum, at their centre of mass.
    pub fn with(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let at = if mass == 0.0 { self.at } else { (self.at * self.mass + other.at * other.mass) / mass };
        Self { mass, at }
    }
}

/// `m (|c|^2 1 - c c^T)`: rotational inertia of a point mass at `c`.
#[inline]
pub fn parallel_axis(mass: f64, c: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(mass * c.norm_squared()) - c * c.transpose() * mass
}

/// Inertia of one or several welded bodies about the common origin, in the common axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialInertia {
    /// Mass (kg).
    pub mass: f64,
    /// First moment, mass times centre of mass (kg m).
    pub moment: Vector3<f64>,
    /// Rotational inertia about the origin (kg m^2).
    pub inertia: Matrix3<f64>,
}

impl SpatialInertia {
    /// Spatial inertia of a body with link frame at rotation `r` and position `x`.
    #[inline]
    pub fn of(body: &BodyInertia, r: &Matrix3<f64>, x: &Vector3<f64>) -> Self {
        let c = r * body.com + x;
        Self {
            mass: body.mass,
            moment: c * body.mass,
            inertia: r * body.inertia * r.transpose() + parallel_axis(body.mass, &c),
        }
    }

    /// Momentum `I m` of the twist `m`.
    #[inline]
    pub fn apply(&self, m: &Motion) -> Wrench {
        Wrench::new(self.inertia * m.ang + self.moment.cross(&m.lin), m.lin * self.mass - self.moment.cross(&m.ang))
    }

    /// The 6x6 matrix `[[I, h x], [-h x, m 1]]`, with h the first moment.
    pub fn matrix(&self) -> Matrix6<f64> {
        let h = self.moment.cross_matrix();
        blocks(&self.inertia, &h, &h.transpose(), &Matrix3::from_diagonal_element(self.mass))
    }
}

/// Block matrix `[[a, b], [c, d]]`.
pub(crate) fn blocks(a: &Matrix3<f64>, b: &Matrix3<f64>, c: &Matrix3<f64>, d: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    for (block, at) in [(a, (0, 0)), (b, (0, 3)), (c, (3, 0)), (d, (3, 3))] {
        m.fixed_view_mut::<3, 3>(at.0, at.1).copy_from(block);
    }
    m
}

impl AddAssign for SpatialInertia {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        self.mass += o.mass;
        self.moment += o.moment;
        self.inertia += o.inertia;
    }
}

/// The shortest rotation of the axis `from` (x or z) onto a direction; onto the opposite one half a turn about z or x.
pub fn rotation_from(from: &UnitVector3<f64>, to: &Vector3<f64>) -> UnitQuaternion<f64> {
    let about = if from.x == 0.0 { Vector3::x_axis() } else { Vector3::z_axis() };
    UnitQuaternion::rotation_between(from, to).unwrap_or_else(|| UnitQuaternion::from_axis_angle(&about, PI))
}
