//! Compares a robot with MuJoCo's compilation of its MJCF: body masses, geom pairs that may touch, their friction and
//! margin.

use std::collections::HashMap;

use nerd_core::contact::ContactPoint;
use nerd_sim::scene::{PairLaw, SurfaceGeom};
use nerd_sim::system::GROUND;
use serde_json::json;

use super::python::Python;
use crate::prelude::*;

const COMPILED: &str = include_str!("compiled.py");
/// Difference that counts as rounding: relative for masses, absolute for friction coefficients and margins (m).
const ROUNDING: f64 = 1e-6;
/// Least friction coefficient in MuJoCo, which raises smaller ones to it.
const LEAST_FRICTION: f64 = 1e-5;

/// MuJoCo's compilation of a file, as `compiled.py` prints it.
#[derive(Deserialize)]
struct Compiled {
    masses: BTreeMap<String, f64>,
    geoms: Vec<Geom>,
    laws: Vec<Law>,
    pairs: Vec<[usize; 3]>,
}

#[derive(Deserialize)]
struct Geom {
    name: String,
    body: String,
    place: usize,
}

#[derive(Deserialize)]
struct Law {
    condim: i64,
    friction: [f64; 5],
    margin: f64,
}

/// Result of the comparison with MuJoCo.
pub struct Compared {
    /// Number of moving bodies whose masses were compared.
    pub bodies: usize,
    /// Number of geom pairs that may touch in MuJoCo.
    pub pairs: usize,
    /// Descriptions of the differences between the robot here and MuJoCo's.
    pub differences: Vec<String>,
}

/// Compares a robot with MuJoCo's compilation of its MJCF at `path`. A static and a moving geom touch here only if the
/// scene has the former, and the latter a contact point. For two moving geoms, the file's contact rules are compared.
pub fn compare(python: &Path, path: &Path, system: &System) -> Result<Compared> {
    let theirs: Compiled = Python::start(python, COMPILED)?.ask(&json!({ "path": path }))?;
    let mut differences = masses(&system.robot, &theirs.masses);
    differences.extend(contacts(system, &theirs)?);
    Ok(Compared { bodies: theirs.masses.len(), pairs: theirs.pairs.len(), differences })
}

/// Lists links whose masses differ from MuJoCo's, and links that only one side has.
fn masses(robot: &Robot, theirs: &BTreeMap<String, f64>) -> Vec<String> {
    // Subtracts a floating root's armature: it is part of our inertia, but of no mass in MuJoCo.
    let mass = |link: &Link| link.inertia.mass - if link.joint.is_none() { robot.free.armature } else { 0.0 };
    let ours: HashMap<&str, f64> = robot.links.iter().map(|link| (link.name.as_str(), mass(link))).collect();
    let body = |(name, theirs): (&String, &f64)| match ours.get(name.as_str()) {
        Some(ours) if (ours - theirs).abs() <= ROUNDING * theirs => None,
        Some(ours) => Some(format!("mass of `{name}`: {} kg here, {} in MuJoCo", digits(*ours), digits(*theirs))),
        None if *theirs < 1e-12 => None,
        None => Some(format!("`{name}` ({} kg) moves in MuJoCo, not here", digits(*theirs))),
    };
    let more = robot.links.iter().filter(|link| link.inertia.mass > 0.0 && !theirs.contains_key(&link.name));
    let more = more.map(|link| format!("`{}` moves here, not in MuJoCo", link.name)).collect_vec();
    theirs.iter().filter_map(body).chain(more).collect()
}

/// Lists geom pairs that touch only here or only in MuJoCo, or with different properties. Here, geoms of one body with
/// equal properties form one surface.
fn contacts(system: &System, theirs: &Compiled) -> Result<Vec<String>> {
    let ours = Ours::of(system)?;
    let surfaces = &system.surfaces.geoms;
    let all =
        surfaces.iter().enumerate().flat_map(|(k, own)| own.geoms.iter().map(move |geom| ((&*own.body, geom.0), k)));
    let numbers: HashMap<(&str, usize), usize> = all.collect();
    let number = |geom: &Geom| numbers.get(&(geom.body.as_str(), geom.place)).copied();
    let mut differences = Vec::new();
    let mut met = HashMap::<_, Vec<&Law>>::new();
    for [a, b, law] in &theirs.pairs {
        let [a, b] = [a, b].map(|k| &theirs.geoms[*k]);
        match [number(a), number(b)] {
            [Some(a), Some(b)] => met.entry([a.min(b), a.max(b)]).or_default().push(&theirs.laws[*law]),
            _ => differences.push(format!("{a} and {b} touch in MuJoCo, not here")),
        }
    }
    for pair @ [a, b] in (0..surfaces.len()).flat_map(|b| (0..b).map(move |a| [a, b])) {
        let theirs = met.get(&pair).map_or(&[][..], Vec::as_slice);
        let names = || pair.map(|k| named(&surfaces[k])).join(" and ");
        differences.extend(match ours.touch(pair) {
            None if theirs.is_empty() => None,
            None => Some(format!("{} touch in MuJoCo, not here{}", names(), ours.lacks(pair))),
            Some(_) if theirs.len() < surfaces[a].geoms.len() * surfaces[b].geoms.len() => {
                Some(format!("{} touch here, not in MuJoCo", names()))
            }
            Some(ours) => {
                theirs.iter().find_map(|law| ours.differs(law)).map(|what| format!("{}: {what} in MuJoCo", names()))
            }
        });
    }
    Ok(differences)
}

impl std::fmt::Display for Geom {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Self { name, body, place } = self;
        if name.is_empty() { write!(f, "geom {place} of `{body}`") } else { write!(f, "`{name}`") }
    }
}

/// Names a surface by its first geom and the number of its other geoms.
fn named(surface: &SurfaceGeom) -> String {
    let (place, name) = surface.geoms.first().cloned().unwrap_or_default();
    let first = Geom { name, body: surface.body.clone(), place };
    if surface.geoms.len() < 2 {
        first.to_string()
    } else {
        format!("{first} (and {} like it)", surface.geoms.len() - 1)
    }
}

/// The robot here and the scene of its file, to find which surfaces touch.
struct Ours<'a> {
    system: &'a System,
    scene: Arc<Scene>,
    /// One contact point of each moving surface, by the surface's index.
    points: HashMap<usize, &'a ContactPoint>,
    /// Indices of the scene's colliders that belong to each static surface, by the surface's index.
    colliders: HashMap<usize, Vec<usize>>,
}

impl<'a> Ours<'a> {
    fn of(system: &'a System) -> Result<Self> {
        let scene =
            [GROUND, "base", "free"].into_iter().find(|scene| system.scene_names().contains(scene)).unwrap_or("free");
        let scene = system.scene(scene)?;
        let points = system.robot.contact_points.iter().filter_map(|point| Some((point.surface?, point))).collect();
        let standing = scene.colliders.iter().enumerate().filter_map(|(k, collider)| Some((collider.surface?, k)));
        let colliders = standing.into_group_map();
        Ok(Self { system, scene, points, colliders })
    }

    fn surface(&self, number: usize) -> &SurfaceGeom {
        &self.system.surfaces.geoms[number]
    }

    /// Returns the first collider of a static surface, if all of the surface's geoms are in the scene.
    fn stands(&self, number: usize) -> Option<&Collider> {
        let places = self.colliders.get(&number).filter(|places| places.len() >= self.surface(number).geoms.len())?;
        places.first().map(|place| &self.scene.colliders[*place])
    }

    /// Returns the contact properties of two surfaces, given by index, if they touch.
    fn touch(&self, [a, b]: [usize; 2]) -> Option<Touch> {
        let law = self.system.surfaces.between(a, b)?;
        let (own, other) = if self.surface(a).still { (b, a) } else { (a, b) };
        if !self.surface(other).still {
            return Some(Touch::from(law));
        }
        let material = self.system.meeting(self.points.get(&own)?, self.stands(other)?)?;
        let friction = [material.friction, material.torsion, material.rolling];
        Some(Touch { condim: law.condim, friction, margin: material.margin })
    }

    /// Says why two surfaces do not touch here although the file's rules let them.
    fn lacks(&self, pair: [usize; 2]) -> &'static str {
        let may = self.system.surfaces.between(pair[0], pair[1]).is_some();
        let lost = |still: bool| {
            pair.into_iter().any(|k| match self.surface(k).still {
                true => still && self.stands(k).is_none(),
                false => !still && !self.points.contains_key(&k),
            })
        };
        match may {
            true if lost(true) => ", since what stands is not in the scene",
            true if lost(false) => ", since what moves has no contact point",
            _ => "",
        }
    }
}

/// Contact properties of two surfaces.
struct Touch {
    condim: i64,
    /// Friction coefficients: sliding, torsional (m) and rolling (m).
    friction: [f64; 3],
    margin: f64,
}

impl From<&PairLaw> for Touch {
    fn from(law: &PairLaw) -> Self {
        Self { condim: law.condim, friction: [law.friction, law.torsion, law.rolling], margin: law.margin }
    }
}

impl Touch {
    /// Describes the first difference from MuJoCo's contact `theirs`. Compares only the friction coefficients that
    /// MuJoCo's contact dimension uses.
    fn differs(&self, theirs: &Law) -> Option<String> {
        if self.condim != theirs.condim {
            return Some(format!("condim {} here, {}", self.condim, theirs.condim));
        }
        let [along, across, torsion, roll, turn] = theirs.friction;
        let [slide, spin, rolling] = self.friction;
        let all = [
            ("friction", 3, slide, along),
            ("friction across", 3, slide, across),
            ("torsional friction", 4, spin, torsion),
            ("rolling friction", 6, rolling, roll),
            ("rolling friction across", 6, rolling, turn),
        ];
        let apart = |what: &str, ours: f64, theirs: f64| {
            ((ours - theirs).abs() > ROUNDING).then(|| format!("{what} {} here, {}", digits(ours), digits(theirs)))
        };
        let friction = all.into_iter().filter(|(_, least, ..)| theirs.condim >= *least);
        let friction = friction
            .filter_map(|(what, _, ours, theirs)| apart(what, ours.max(LEAST_FRICTION), theirs.max(LEAST_FRICTION)));
        friction.chain(apart("margin", self.margin, theirs.margin)).next()
    }
}
