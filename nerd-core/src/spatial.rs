//! Spatial (6-D) algebra in one common frame.
//!
//! **Word order: angular first, then linear.** A [`Motion`] is `(w, v)`: w is the angular velocity (rad/s), and v the
//! velocity (m/s) of the body's point at the frame's origin. A [`Wrench`] is `(n, f)`: the moment n about that origin
//! (N m) and the force f (N). All vectors of one computation share one frame: world axes, origin at the root
//! ([`crate::dynamics`]). So no transforms between links are needed. Source: Featherstone, *Rigid Body Dynamics
//! Algorithms* (2008), chapter 2, without Pluecker transforms.

use std::f64::consts::PI;
use std::ops::{Add, AddAssign, Mul, Sub};

use nalgebra::{Matrix3, Matrix6, Rotation3, UnitQuaternion, UnitVector3, Vector3, Vector6};

/// A twist (rad/s, m/s) or a spatial acceleration (rad/s^2, m/s^2): angular part, then linear part at the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Angular part (rad/s or rad/s^2).
    pub ang: Vector3<f64>,
    /// Linear part at the origin (m/s or m/s^2).
    pub lin: Vector3<f64>,
}

/// A wrench, or a momentum. A wrench has a moment about the origin (N m) and a force (N).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Moment about the origin (N m); angular momentum (N m s) of a momentum.
    pub ang: Vector3<f64>,
    /// Force (N); linear momentum (N s) of a momentum.
    pub lin: Vector3<f64>,
}

impl Motion {
    /// The k-th unit motion, `k` in 0..6: three angular axes, then three linear ones.
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
    /// The wrench (N m, N), about the origin, of the force `f` (N) at the position `x` (m).
    #[inline]
    pub fn force_at(f: Vector3<f64>, x: &Vector3<f64>) -> Self {
        Self::new(x.cross(&f), f)
    }
}

macro_rules! linear {
    ($t:ty) => {
        impl $t {
            /// Makes the vector from its angular and its linear part.
            #[inline]
            pub fn new(ang: Vector3<f64>, lin: Vector3<f64>) -> Self {
                Self { ang, lin }
            }

            /// All six numbers in one vector: the angular part, then the linear part.
            #[inline]
            pub fn vector(&self) -> Vector6<f64> {
                Vector6::new(self.ang.x, self.ang.y, self.ang.z, self.lin.x, self.lin.y, self.lin.z)
            }

            /// Reads the first six numbers of `x`: the angular part, then the linear part.
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
    /// The inertia of the same body in another frame, in which the link frame has pose (`rotation`, `translation` in
    /// m).
    pub fn transformed(&self, rotation: &Rotation3<f64>, translation: &Vector3<f64>) -> Self {
        let r = rotation.matrix();
        Self { mass: self.mass, com: r * self.com + translation, inertia: r * self.inertia * r.transpose() }
    }

    /// The inertia of this body and `other` welded together, by the parallel-axis theorem (exact).
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

/// `m (|c|^2 1 - c c^T)`: rotational inertia (kg m^2) about the origin of a point mass m (kg) at `c` (m).
#[inline]
pub fn parallel_axis(mass: f64, c: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(mass * c.norm_squared()) - c * c.transpose() * mass
}

/// Inertia of one body, or of several welded together, about the origin of the frame that a computation shares.
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
    /// Spatial inertia of a body whose link frame has rotation `r` and position `x` (m).
    #[inline]
    pub fn of(body: &BodyInertia, r: &Matrix3<f64>, x: &Vector3<f64>) -> Self {
        let c = r * body.com + x;
        Self {
            mass: body.mass,
            moment: c * body.mass,
            inertia: r * body.inertia * r.transpose() + parallel_axis(body.mass, &c),
        }
    }

    /// Momentum `I m` (N m s, N s) of the twist `m` (rad/s, m/s).
    #[inline]
    pub fn apply(&self, m: &Motion) -> Wrench {
        Wrench::new(self.inertia * m.ang + self.moment.cross(&m.lin), m.lin * self.mass - self.moment.cross(&m.ang))
    }

    /// The 6x6 matrix `[[I, h x], [-h x, m 1]]`, with I the rotational inertia, h the first moment and m the mass.
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

/// The shortest rotation of the axis `from` (x or z) onto the direction `to`. Onto the opposite direction it is half a
/// turn: about z for x, about x for z.
pub fn rotation_from(from: &UnitVector3<f64>, to: &Vector3<f64>) -> UnitQuaternion<f64> {
    let about = if from.x == 0.0 { Vector3::x_axis() } else { Vector3::z_axis() };
    UnitQuaternion::rotation_between(from, to).unwrap_or_else(|| UnitQuaternion::from_axis_angle(&about, PI))
}
