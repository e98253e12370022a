//! Contact filtering and mixing of contact parameters, by MuJoCo's rules.

use std::collections::HashMap;

use super::geom::{Geom, Type};
use super::model::Model;
use super::shapes::Shapes;
use super::tree::Tree;
use crate::internal::*;
use crate::scene::{PairLaw, Softness, SurfaceGeom, Surfaces};

/// Data of a model that decides which geoms collide, and by which law.
pub(super) struct Contacts<'a> {
    model: &'a Model,
    /// `weld`: for each body, the nearest of itself and its ancestors that has joints or is a mocap body, else the
    /// world. `above`: for each body, the weld of the parent of its weld.
    weld: Vec<usize>,
    above: Vec<usize>,
    excluded: Vec<[usize; 2]>,
    /// Explicit pairs of geoms, each geom as (body, index within it), with the pair's index.
    pairs: Vec<([[usize; 2]; 2], usize)>,
    off: bool,
}

impl<'a> Contacts<'a> {
    pub fn new(model: &'a Model) -> Result<Self, UrdfError> {
        let mut weld = vec![0; model.bodies.len()];
        for (id, body) in model.bodies.iter().enumerate().skip(1) {
            weld[id] = if body.joints.is_empty() && !body.mocap { weld[body.parent] } else { id };
        }
        let above = weld.iter().map(|own| weld[model.bodies[*own].parent]).collect();
        let bodies: HashMap<&str, usize> =
            model.bodies.iter().enumerate().filter_map(|(id, body)| Some((body.name.as_deref()?, id))).collect();
        let body = |name: &str| if name == "world" { Some(0) } else { bodies.get(name).copied() };
        let mut excluded = Vec::new();
        for (names, e) in &model.excluded {
            let find = |name: &String| {
                body(name).ok_or_else(|| e.refused(format!("there is no body `{}`", name.escape_debug())))
            };
            excluded.push([find(&names[0])?, find(&names[1])?]);
        }
        let all = model
            .bodies
            .iter()
            .enumerate()
            .flat_map(|(id, body)| body.geoms.iter().enumerate().map(move |(k, geom)| ([id, k], geom)));
        let geoms: HashMap<&str, [usize; 2]> =
            all.filter_map(|(place, geom)| Some((geom.name.as_deref()?, place))).collect();
        let mut pairs = Vec::new();
        for (k, pair) in model.pairs.iter().enumerate() {
            let find = |name: &String| geoms.get(name.as_str()).copied();
            let [Some(one), Some(other)] = [&pair.geoms[0], &pair.geoms[1]].map(find) else {
                return Err(pair
                    .element
                    .refused(format!("geom `{}` or `{}` is not there", pair.geoms[0], pair.geoms[1])));
            };
            pairs.push(([one, other], k));
        }
        let off = model.options.is_off("contact") || model.options.is_off("constraint");
        Ok(Self { model, weld, above, excluded, pairs, off })
    }
}

impl Contacts<'_> {
    fn geom(&self, [id, k]: [usize; 2]) -> &Geom {
        &self.model.bodies[id].geoms[k]
    }

    /// Whether the body to which body `id` is welded has joints.
    fn moves(&self, id: usize) -> bool {
        !self.model.bodies[self.weld[id]].joints.is_empty()
    }

    /// Contact law of two geoms, each as (body, index within it); `None` if they never collide.
    pub fn law(&self, one: [usize; 2], other: [usize; 2]) -> Option<PairLaw> {
        if self.off || !(self.moves(one[0]) || self.moves(other[0])) || self.weld[one[0]] == self.weld[other[0]] {
            return None;
        }
        let law = match self.pairs.iter().find(|(geoms, _)| *geoms == [one, other] || *geoms == [other, one]) {
            Some((_, k)) => paired(&self.model.pairs[*k].law),
            None if self.kept_apart(one[0], other[0]) => return None,
            None => mixed(self.geom(one), self.geom(other))?,
        };
        Some(self.overridden(law))
    }

    /// Contact law of a geom with a collider from outside the file, which counts as a geom with MuJoCo's defaults.
    pub fn with_default(&self, one: [usize; 2]) -> Option<PairLaw> {
        let law = mixed(self.geom(one), &Geom::default()).filter(|_| !self.off);
        law.map(|law| self.overridden(law))
    }

    /// Whether two geoms of a body have the same contact laws with all other geoms.
    pub fn alike(&self, id: usize, [k, other]: [usize; 2]) -> bool {
        let properties = |k: usize| {
            let Geom { contype, conaffinity, condim, priority, friction, solmix, softness, margin, .. } =
                *self.geom([id, k]);
            ((contype, conaffinity, condim, priority), friction, solmix, softness, margin)
        };
        let paired = |k: usize| self.pairs.iter().any(|(geoms, _)| geoms.contains(&[id, k]));
        let plane = |k: usize| self.geom([id, k]).kind == Type::Plane;
        properties(k) == properties(other) && ![k, other].into_iter().any(|k| paired(k) || plane(k))
    }

    /// Whether two bodies never collide, whatever their geoms' parameters: a parent and its child, or an excluded pair.
    fn kept_apart(&self, one: usize, other: usize) -> bool {
        let [a, b] = [self.weld[one], self.weld[other]];
        let parent = self.above[one] == b || self.above[other] == a;
        let excluded = self.excluded.iter().any(|pair| *pair == [one, other] || *pair == [other, one]);
        excluded || !self.model.options.parents && parent && a != 0 && b != 0
    }

    fn overridden(&self, law: PairLaw) -> PairLaw {
        let Some(all) = &self.model.options.contact else { return law };
        let [slide, across, torsion, roll, _] = all.friction;
        law_of([0.5 * (slide + across), torsion, roll], law.condim, all.margin, all.softness)
    }

    /// Whether a geom may collide with another geom, or with a collider from outside the file.
    pub fn touches(&self, id: usize, k: usize) -> bool {
        let geom = self.geom([id, k]);
        // A plane is the ground of the file's scene, even if the file filters its contacts.
        geom.kind == Type::Plane
            || !self.off
                && (geom.contype != 0
                    || geom.conaffinity != 0
                    || self.pairs.iter().any(|(geoms, _)| geoms.contains(&[id, k])))
    }
}

/// Contact law from an explicit pair; the two tangential friction coefficients are averaged.
fn paired(pair: &super::classes::Pair) -> PairLaw {
    let mut friction = [1.0, 1.0, 0.005, 0.0001, 0.0001];
    let given = pair.friction.as_deref().unwrap_or_default();
    friction[..given.len()].copy_from_slice(given);
    let [slide, across, torsion, roll, _] = friction;
    law_of(
        [0.5 * (slide + across), torsion, roll],
        pair.condim.unwrap_or(3),
        pair.margin.unwrap_or(0.0),
        pair.softness.unwrap_or_default(),
    )
}

/// Contact law mixed from both geoms: parameters of the geom with higher priority; for equal priority the larger
/// friction and dimension. `None` if their contact bits exclude each other.
fn mixed(a: &Geom, b: &Geom) -> Option<PairLaw> {
    if a.contype & b.conaffinity == 0 && a.conaffinity & b.contype == 0 {
        return None;
    }
    let margin = a.margin + b.margin;
    let alone = |geom: &Geom| law_of(geom.friction, geom.condim, margin, geom.softness);
    Some(match a.priority.cmp(&b.priority) {
        std::cmp::Ordering::Greater => alone(a),
        std::cmp::Ordering::Less => alone(b),
        std::cmp::Ordering::Equal => {
            let condim = a.condim.max(b.condim);
            let friction = [0, 1, 2].map(|k| a.friction[k].max(b.friction[k]));
            law_of(friction, condim, margin, softness(a, b))
        }
    })
}

fn softness(a: &Geom, b: &Geom) -> Softness {
    const MIN_SOLMIX: f64 = 1e-15;
    let share = match [a.solmix, b.solmix] {
        [x, y] if x < MIN_SOLMIX && y < MIN_SOLMIX => 0.5,
        [x, _] if x < MIN_SOLMIX => 0.0,
        [_, y] if y < MIN_SOLMIX => 1.0,
        [x, y] => x / (x + y),
    };
    let mix = |x: f64, y: f64| share * x + (1.0 - share) * y;
    let direct = a.softness.solref[0] <= 0.0 || b.softness.solref[0] <= 0.0;
    let solref = [0, 1].map(|k| {
        let [x, y] = [a.softness.solref[k], b.softness.solref[k]];
        if direct { x.min(y) } else { mix(x, y) }
    });
    Softness { solref, solimp: std::array::from_fn(|k| mix(a.softness.solimp[k], b.softness.solimp[k])) }
}

/// Contact law with the friction components that `condim` includes; the others are zero.
fn law_of([slide, torsion, roll]: [f64; 3], condim: i64, margin: f64, softness: Softness) -> PairLaw {
    let on = |least: i64, x: f64| if condim >= least { x.max(0.0) } else { 0.0 };
    PairLaw {
        condim,
        friction: on(3, slide),
        torsion: on(4, torsion),
        rolling: on(6, roll),
        margin,
        softness,
        factors: [1.0; 2],
        release: 0.0,
    }
}

/// Contact laws of all geoms that may collide, by surface number.
pub(super) fn surfaces(tree: &Tree, contacts: &Contacts, shapes: &Shapes) -> Surfaces {
    let model = tree.model;
    let places = &shapes.touching;
    let geoms = places.iter().map(|(id, places)| {
        let name = |place: &usize| (*place, contacts.geom([*id, *place]).name.clone().unwrap_or_default());
        SurfaceGeom { body: tree.links[*id].clone(), geoms: places.iter().map(name).collect(), still: model.still(*id) }
    });
    let places: Vec<[usize; 2]> = places.iter().map(|(id, places)| [*id, places[0]]).collect();
    let ground = places.iter().find(|place| contacts.geom(**place).kind == Type::Plane && model.still(place[0]));
    let other = |place: [usize; 2]| match ground {
        _ if model.still(place[0]) => None,
        Some(ground) => contacts.law(place, *ground),
        None => contacts.with_default(place),
    };
    let mut surfaces = Surfaces::new(geoms.collect(), |a, b| contacts.law(places[a], places[b]), |a| other(places[a]));
    (surfaces.elliptic, surfaces.impratio, surfaces.step) =
        (model.options.elliptic, model.options.impratio, model.options.step);
    surfaces
}
