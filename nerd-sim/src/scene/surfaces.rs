//! How the geoms of a robot's file touch: which of them meet, and with what friction, margin and softness.

use crate::internal::*;

/// Geoms of one body that may touch something and have the same contact properties.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SurfaceGeom {
    /// Name of the body.
    pub body: String,
    /// Their places among the geoms of the body, in the order of the file, and their names, which may be empty.
    pub geoms: Vec<(usize, String)>,
    /// Whether they stand in the world.
    pub still: bool,
}

/// Softness of a contact as MuJoCo has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softness {
    /// Time constant (s) and damping ratio; or, below zero, stiffness (1/s^2) and damping (1/s).
    pub solref: [f64; 2],
    /// Impedance where the surfaces meet and at the width, that width (m), midpoint, power.
    pub solimp: [f64; 5],
}

impl Default for Softness {
    fn default() -> Self {
        Self { solref: [0.02, 1.0], solimp: [0.9, 0.95, 0.001, 0.5, 2.0] }
    }
}

/// How two geoms touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairLaw {
    /// Dimension of the contact: 1 without friction, 3 with sliding, 4 with torsional, 6 with rolling friction, too.
    pub condim: i64,
    /// Coefficient of sliding friction.
    pub friction: f64,
    /// Torsional friction (m): largest torque about the normal over the normal force.
    pub torsion: f64,
    /// Rolling friction (m): largest torque across the normal over the normal force.
    pub rolling: f64,
    /// Distance (m) at which the force begins.
    pub margin: f64,
    /// Softness in the file.
    pub softness: Softness,
    /// Stiffness and damping over those of the robot's material, which follow from that.
    pub factors: [f64; 2],
    /// Time (s) in which a point inside comes out: MuJoCo damps both ways alike.
    pub release: f64,
}

impl PairLaw {
    /// All that its motion depends on.
    pub(crate) fn numbers(&self) -> [f64; 6] {
        [self.friction, self.torsion, self.rolling, self.margin, self.factors[0], self.factors[1]]
    }
}

/// How a contact point meets a collider.
#[derive(Clone, Copy, Debug)]
pub enum Meeting<'a> {
    /// By the materials of robot and collider.
    Plain,
    /// As the file says.
    Law(&'a PairLaw),
}

/// The geoms of a robot's file by number, and how they touch.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    /// Geoms that may touch something.
    pub geoms: Vec<SurfaceGeom>,
    laws: Vec<PairLaw>,
    /// By two numbers, place among the laws plus one; 0 of geoms that never meet.
    index: Vec<u32>,
    /// By number, how a geom touches a scene that the file does not have: as the file's ground, or else as a geom of MuJoCo's defaults.
    others: Vec<Option<PairLaw>>,
    /// Whether friction cones are elliptic.
    pub elliptic: bool,
    /// Ratio of the impedances of friction and contact.
    pub impratio: f64,
    /// Time of MuJoCo's step (s).
    pub step: f64,
}

impl Surfaces {
    /// Of geoms, of which `law` says how two touch, and `other` how one touches another scene.
    pub(crate) fn new(
        geoms: Vec<SurfaceGeom>,
        law: impl Fn(usize, usize) -> Option<PairLaw>,
        other: impl Fn(usize) -> Option<PairLaw>,
    ) -> Self {
        let n = geoms.len();
        let (mut laws, mut index) = (Vec::new(), vec![0; n * n]);
        for (a, b) in (0..n).flat_map(|b| (0..b).map(move |a| (a, b))) {
            if let Some(law) = law(a, b) {
                laws.push(law);
                (index[a * n + b], index[b * n + a]) = (laws.len() as u32, laws.len() as u32);
            }
        }
        Self { laws, index, others: (0..n).map(other).collect(), geoms, elliptic: false, impratio: 1.0, step: 0.002 }
    }

    /// Whether a file says nothing of contact.
    pub fn is_empty(&self) -> bool {
        self.geoms.is_empty()
    }

    /// How two geoms touch, none if they never do.
    pub fn between(&self, a: usize, b: usize) -> Option<&PairLaw> {
        let place = self.index[a * self.geoms.len() + b] as usize;
        place.checked_sub(1).map(|place| &self.laws[place])
    }

    /// How a contact point meets a collider; none if it never does.
    #[inline]
    pub fn meeting(&self, point: &ContactPoint, collider: &Collider) -> Option<Meeting<'_>> {
        let Some(own) = point.surface.filter(|own| *own < self.geoms.len()) else { return Some(Meeting::Plain) };
        let law = match collider.surface {
            Some(other) => self.between(own, other),
            None => self.others[own].as_ref(),
        };
        law.map(Meeting::Law)
    }

    /// How a geom touches the ground and what stands in its file's world.
    pub(crate) fn row(&self, number: usize) -> Vec<Option<[f64; 6]>> {
        let still = (0..self.geoms.len()).filter(|k| self.geoms[*k].still);
        let laws = still.map(|k| self.between(number, k)).chain([self.others[number].as_ref()]);
        laws.map(|law| law.map(PairLaw::numbers)).collect()
    }

    /// How a geom touches a scene that the file does not have.
    pub fn other(&self, number: usize) -> Option<&PairLaw> {
        self.others[number].as_ref()
    }

    /// Largest margin of a contact with a scene (m).
    pub fn margin(&self) -> f64 {
        self.all().map(|law| law.margin).fold(0.0, f64::max)
    }

    /// Whether a contact has torsional or rolling friction.
    pub fn turns(&self) -> bool {
        self.all().any(|law| law.torsion > 0.0 || law.rolling > 0.0)
    }

    fn all(&self) -> impl Iterator<Item = &PairLaw> {
        self.laws.iter().chain(self.others.iter().flatten())
    }

    /// Changes every law, given the numbers of its two geoms; of one with another scene the second is none.
    pub(crate) fn each(&mut self, mut change: impl FnMut(usize, Option<usize>, &mut PairLaw)) {
        let n = self.geoms.len();
        for (a, b) in (0..n).flat_map(|b| (0..b).map(move |a| (a, b))) {
            if let Some(place) = (self.index[a * n + b] as usize).checked_sub(1) {
                change(a, Some(b), &mut self.laws[place]);
            }
        }
        self.others.iter_mut().enumerate().for_each(|(a, law)| law.iter_mut().for_each(|law| change(a, None, law)));
    }

    /// The median friction of its geoms with the ground.
    pub fn usual_friction(&self) -> Option<f64> {
        let mut all: Vec<f64> = self.others.iter().flatten().map(|law| law.friction).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len().saturating_sub(1) / 2).copied()
    }
}

impl Material {
    /// As a pair of geoms has it; `one` is the friction of all contacts, where it was set.
    pub(crate) fn by(&self, law: &PairLaw, collider: &Collider, one: Option<f64>) -> Self {
        let friction = match one.filter(|_| law.condim > 1) {
            Some(one) => one,
            // A scene with a material of its own.
            None if collider.stated && law.condim > 1 => 0.5 * (collider.material.friction + law.friction),
            None => law.friction,
        };
        self.pair(law, friction)
    }

    /// The same with a friction.
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
