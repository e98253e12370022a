//! Contact laws between the geoms of a robot's file: which pairs collide, with what friction, margin and softness.

use crate::internal::*;

/// Geoms of a body that may collide and have equal contact parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SurfaceGeom {
    /// Name of the body.
    pub body: String,
    /// Index of each geom among the body's geoms, in file order, and its name, which may be empty.
    pub geoms: Vec<(usize, String)>,
    /// Whether the body is static.
    pub still: bool,
}

/// Softness of a contact in MuJoCo's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softness {
    /// Time constant (s) and damping ratio; if negative, stiffness (1/s^2) and damping (1/s).
    pub solref: [f64; 2],
    /// Impedance at first contact and at the width, width (m), midpoint, power.
    pub solimp: [f64; 5],
}

impl Default for Softness {
    fn default() -> Self {
        Self { solref: [0.02, 1.0], solimp: [0.9, 0.95, 0.001, 0.5, 2.0] }
    }
}

/// Contact law of a pair of geoms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairLaw {
    /// Contact dimension: 1 without friction, 3 with sliding, 4 with torsional, 6 with rolling friction.
    pub condim: i64,
    /// Coefficient of sliding friction.
    pub friction: f64,
    /// Torsional friction (m): ratio of the largest torque about the normal to the normal force.
    pub torsion: f64,
    /// Rolling friction (m): ratio of the largest torque across the normal to the normal force.
    pub rolling: f64,
    /// Contact margin (m): the force begins at this distance.
    pub margin: f64,
    /// Softness from the file.
    pub softness: Softness,
    /// Factors on stiffness and damping of the robot's material, derived from `softness`.
    pub factors: [f64; 2],
    /// Time constant (s) of resolving a penetration. Its value gives equal damping while approaching and separating, as
    /// in MuJoCo.
    pub release: f64,
}

impl PairLaw {
    /// The parameters that the motion depends on.
    pub(crate) fn numbers(&self) -> [f64; 6] {
        [self.friction, self.torsion, self.rolling, self.margin, self.factors[0], self.factors[1]]
    }
}

/// Contact law of a contact point and a collider.
#[derive(Clone, Copy, Debug)]
pub enum Meeting<'a> {
    /// Mean material of robot and collider.
    Plain,
    /// The law from the file.
    Law(&'a PairLaw),
}

/// Contact laws between the geoms of a robot's file, by surface number.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    /// Geoms that may collide, by surface number.
    pub geoms: Vec<SurfaceGeom>,
    laws: Vec<PairLaw>,
    /// For a pair of surface numbers: index into `laws` plus one; 0 for geoms that never collide.
    index: Vec<u32>,
    /// Law of each surface against colliders from outside the file: as against the file's ground, else against a geom
    /// with MuJoCo's defaults.
    others: Vec<Option<PairLaw>>,
    /// Whether the friction cones are elliptic.
    pub elliptic: bool,
    /// Ratio of frictional to normal impedance.
    pub impratio: f64,
    /// Time step of MuJoCo (s).
    pub step: f64,
}

impl Surfaces {
    /// `law` gives the contact law of two geoms, `other` of a geom with colliders from outside the file.
    pub(crate) fn new(
        geoms: Vec<SurfaceGeom>,
        law: impl Fn(usize, usize) -> Option<PairLaw>,
        other: impl Fn(usize) -> Option<PairLaw>,
    ) -> Self {
        let n = geoms.len();
        let mut laws = Vec::new();
        let mut index = vec![0; n * n];
        for (a, b) in (0..n).flat_map(|b| (0..b).map(move |a| (a, b))) {
            if let Some(law) = law(a, b) {
                laws.push(law);
                (index[a * n + b], index[b * n + a]) = (laws.len() as u32, laws.len() as u32);
            }
        }
        Self { laws, index, others: (0..n).map(other).collect(), geoms, elliptic: false, impratio: 1.0, step: 0.002 }
    }

    /// Whether the file defines no contacts.
    pub fn is_empty(&self) -> bool {
        self.geoms.is_empty()
    }

    /// Contact law of two geoms; `None` if they never collide.
    pub fn between(&self, a: usize, b: usize) -> Option<&PairLaw> {
        let place = self.index[a * self.geoms.len() + b] as usize;
        place.checked_sub(1).map(|place| &self.laws[place])
    }

    /// Contact law of a contact point and a collider; `None` if they never collide.
    #[inline]
    pub fn meeting(&self, point: &ContactPoint, collider: &Collider) -> Option<Meeting<'_>> {
        let Some(own) = point.surface.filter(|own| *own < self.geoms.len()) else { return Some(Meeting::Plain) };
        let law = match collider.surface {
            Some(other) => self.between(own, other),
            None => self.others[own].as_ref(),
        };
        law.map(Meeting::Law)
    }

    /// Parameters of a surface against each static geom of its file, then against colliders from outside the file.
    pub(crate) fn row(&self, number: usize) -> Vec<Option<[f64; 6]>> {
        let still = (0..self.geoms.len()).filter(|k| self.geoms[*k].still);
        let laws = still.map(|k| self.between(number, k)).chain([self.others[number].as_ref()]);
        laws.map(|law| law.map(PairLaw::numbers)).collect()
    }

    /// Contact law of a surface against colliders from outside the file.
    pub fn other(&self, number: usize) -> Option<&PairLaw> {
        self.others[number].as_ref()
    }

    /// Largest margin of all laws (m).
    pub fn margin(&self) -> f64 {
        self.all().map(|law| law.margin).fold(0.0, f64::max)
    }

    /// Whether any law has torsional or rolling friction.
    pub fn turns(&self) -> bool {
        self.all().any(|law| law.torsion > 0.0 || law.rolling > 0.0)
    }

    fn all(&self) -> impl Iterator<Item = &PairLaw> {
        self.laws.iter().chain(self.others.iter().flatten())
    }

    /// Calls `change` for every law, with the surface numbers of its two geoms; the second is `None` for colliders from
    /// outside the file.
    pub(crate) fn each(&mut self, mut change: impl FnMut(usize, Option<usize>, &mut PairLaw)) {
        let n = self.geoms.len();
        for (a, b) in (0..n).flat_map(|b| (0..b).map(move |a| (a, b))) {
            if let Some(place) = (self.index[a * n + b] as usize).checked_sub(1) {
                change(a, Some(b), &mut self.laws[place]);
            }
        }
        self.others.iter_mut().enumerate().for_each(|(a, law)| law.iter_mut().for_each(|law| change(a, None, law)));
    }

    /// Median friction coefficient of the geoms against the ground.
    pub fn usual_friction(&self) -> Option<f64> {
        let mut all: Vec<f64> = self.others.iter().flatten().map(|law| law.friction).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len().saturating_sub(1) / 2).copied()
    }
}

impl Material {
    /// Material of a contact under `law`; `one`, if set, is the friction coefficient of all contacts with friction.
    pub(crate) fn by(&self, law: &PairLaw, collider: &Collider, one: Option<f64>) -> Self {
        let friction = match one.filter(|_| law.condim > 1) {
            Some(one) => one,
            // If the scene states a material, the pair has the mean of both friction coefficients.
            None if collider.stated && law.condim > 1 => 0.5 * (collider.material.friction + law.friction),
            None => law.friction,
        };
        self.pair(law, friction)
    }

    /// Material of a contact under `law`, with the given friction coefficient.
    pub(crate) fn pair(&self, law: &PairLaw, friction: f64) -> Self {
        Self {
            stiffness: self.stiffness * law.factors[0],
            damping: self.damping * law.factors[1],
            friction_damping: self.friction_damping,
            friction,
            torsion: law.torsion,
            rolling: law.rolling,
            margin: law.margin,
            release: law.release,
        }
    }
}
