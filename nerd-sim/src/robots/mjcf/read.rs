//! Reads the elements of an MJCF into a model.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::actuator::Actuator;
use super::element::Element;
use super::field::fields;
use super::fit::fit;
use super::mesh::meshes;
use super::model::{Body, Coupling, GeomPair, Key, Model};
use super::names::Names;
use super::option::Options;
use super::parse::Parser;
use super::placement::Placement;
use super::schema::check;
use super::scope::Scope;
use super::source::Source;
use super::texture;
use crate::internal::*;

/// Attributes that let a tendon exert forces on its joints.
const ACTS: [&str; 7] = ["stiffness", "damping", "frictionloss", "armature", "range", "limited", "springyield"];

/// Sections with named objects.
const NAMED: [&str; 9] =
    ["asset", "contact", "tendon", "equality", "actuator", "sensor", "custom", "keyframe", "deformable"];

/// Reads a model with all models attached to it.
#[derive(Default)]
pub(super) struct Reader {
    pub model: Model,
    pub names: Names,
    /// `copies`: number of replicas made so far; `depth`: nesting of attached models.
    pub copies: usize,
    pub depth: usize,
    /// Names of the replicas of each joint.
    pub copied: HashMap<String, Vec<String>>,
}

/// Root element of a text, checked against the schema.
pub(super) fn root(text: &str, file: Option<&str>, folder: &Path) -> Result<Element, UrdfError> {
    let root = Parser { folder, length: 0, seen: HashSet::new() }.parse(text, file, folder, 0)?;
    check(&root).map(|()| root)
}

impl Model {
    /// Reads the text of a file in `folder`.
    pub fn read(text: &str, folder: &Path) -> Result<Self, UrdfError> {
        let root = root(text, None, folder)?;
        let source = Arc::new(Source::read(&root, folder)?);
        let mut reader = Reader::default();
        reader.model.name = root.text("model").unwrap_or("mjcf").into();
        reader.model.options = Options::read(&root)?;
        let element = Element {
            tag: "worldbody".into(),
            children: Vec::new(),
            attributes: Vec::new(),
            place: root.place.clone(),
        };
        reader.model.bodies.push(Body::new(Isometry3::identity(), 0, element, source.clone()));
        let at = Placement { frame: Isometry3::identity(), prefix: String::new(), suffix: String::new() };
        let scope = Scope { source, body: 0, class: None, at };
        reader.names.add("body", "world", &scope);
        for world in root.all("worldbody") {
            reader.fill(world, &scope)?;
        }
        reader.sections(&root, &scope)?;
        fit(&mut reader.model)?;
        reader.model.tie()?;
        reader.names.check()?;
        reader.model.sizes()?;
        Ok(reader.model)
    }
}

impl Reader {
    /// Reads everything but bodies: meshes, actuators, couplings, contacts, keyframes. The scope adds prefix and suffix
    /// to names.
    pub fn sections(&mut self, root: &Element, scope: &Scope) -> Result<(), UrdfError> {
        self.model.meshes.extend(meshes(root, scope)?);
        self.model.fields.extend(fields(root, scope)?);
        for section in &root.children {
            for e in &section.children {
                if NAMED.contains(&section.tag.as_str()) {
                    self.names.take(e, &section.tag, scope, self.depth > 0)?;
                }
                match (section.tag.as_str(), e.tag.as_str()) {
                    ("equality", _) => self.equality(e, scope)?,
                    ("actuator", _) => self.actuator(e, scope)?,
                    ("contact", "pair") => {
                        let mut law = scope.source.classes.of(e, None)?.pair.clone();
                        law.apply(e)?;
                        if let Some(condim) = law.condim.filter(|condim| ![1, 3, 4, 6].contains(condim)) {
                            return Err(e.refused(format!("condim is {condim}; it is 1, 3, 4 or 6")));
                        }
                        self.model.pairs.push(GeomPair {
                            geoms: both(e, ["geom1", "geom2"], scope)?,
                            law,
                            element: e.clone(),
                        });
                    }
                    ("contact", _) => self.model.excluded.push((both(e, ["body1", "body2"], scope)?, e.clone())),
                    ("keyframe", _) => {
                        let q = e.list("qpos")?;
                        self.model.keys.push(Key {
                            name: e.word("name").unwrap_or_default().into(),
                            q,
                            element: e.clone(),
                        });
                    }
                    ("tendon", _) => self.tendon(e, scope)?,
                    ("asset", "texture") => texture::check(e, scope)?,
                    ("custom", "numeric") if e.word("data").is_none() && !e.has("size") => {
                        return Err(e.refused("it needs data or size"));
                    }
                    ("custom", "tuple") if e.children.is_empty() => {
                        return Err(e.refused("it has no elements; leave it out"));
                    }
                    ("deformable", "flex") => return Err(e.refused("it is not supported; leave it out")),
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// Reads a fixed tendon; refuses a tendon that exerts forces itself.
    fn tendon(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        let says = |key: &&&str| {
            e.text(key).is_some_and(|value| value != "false" && value.split_whitespace().any(|x| x.parse() != Ok(0.0)))
        };
        if let Some(key) = ACTS.iter().find(says) {
            return Err(
                e.refused(format!("a tendon with `{key}` acts on joints, which is not supported; leave it out"))
            );
        }
        let mut joints: Vec<(String, f64)> = Vec::new();
        for part in e.all("joint") {
            let joint = part.word("joint").unwrap_or_default();
            if joints.iter().any(|(name, _)| *name == scope.at.name(joint)) {
                return Err(part.refused("the tendon has this joint twice"));
            }
            let coefficient = part.number("coef")?.unwrap_or(1.0);
            if coefficient != 0.0 {
                joints.push((scope.at.name(joint), coefficient));
            }
        }
        if e.children.len() < if e.tag == "fixed" { 1 } else { 2 } {
            return Err(e.refused("it goes along too little; a fixed one has joints, another one two places or more"));
        }
        let twice = |two: &[Element]| {
            two[0].tag == "site" && two[1].tag == "site" && two[0].text("site") == two[1].text("site")
        };
        if let Some(two) = e.children.windows(2).find(|two| twice(two)) {
            return Err(two[1].refused("the tendon goes to the site at which it is"));
        }
        if e.tag == "fixed" {
            self.model.tendons.insert(scope.at.name(e.word("name").unwrap_or_default()), joints);
        }
        Ok(())
    }

    fn equality(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        let twice = |[a, b]: &[&str; 2]| e.word(a).is_some_and(|name| e.word(b) == Some(name));
        if let Some([a, b]) = [["joint1", "joint2"], ["body1", "body2"], ["site1", "site2"], ["tendon1", "tendon2"]]
            .iter()
            .find(|k| twice(k))
        {
            return Err(e.refused(format!("{a} and {b} are the same; write two")));
        }
        let active = e.flag("active").or(scope.source.classes.of(e, None)?.active).unwrap_or(true);
        if !active || self.model.options.is_off("equality") || self.model.options.is_off("constraint") {
            return Ok(());
        }
        let mut polynomial = [0.0, 1.0, 0.0, 0.0, 0.0];
        if e.tag == "tendon" && !e.has("tendon2") {
            e.fill("polycoef", &mut polynomial)?;
            let tendon =
                e.word("tendon1").map(|name| scope.at.name(name)).ok_or_else(|| e.refused("it names no tendon1"))?;
            self.model.taut.push((tendon, polynomial[0], e.clone()));
            return Ok(());
        }
        if e.tag != "joint" {
            return Err(
                e.refused("it is not supported, since robots are trees of hinges and slides; leave it out, or write active=\"false\"")
            );
        }
        let joint = e.word("joint1").map(|name| scope.at.name(name)).ok_or_else(|| e.refused("it names no joint1"))?;
        e.fill("polycoef", &mut polynomial)?;
        let leader = e.word("joint2").map(|name| scope.at.name(name));
        self.model.couplings.push(Coupling { joint, leader, polynomial, element: e.clone() });
        Ok(())
    }

    fn actuator(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        if self.model.options.is_off("actuation") {
            return Ok(());
        }
        let mut actuator: Actuator = scope.source.classes.of(e, None)?.actuator.clone();
        actuator.apply(e)?;
        if self.model.options.groups.contains(&actuator.group) {
            return Ok(());
        }
        actuator.check(e)?;
        actuator.tendon = actuator.tendon.map(|name| scope.at.name(&name));
        let Some(joint) = actuator.joint.take() else {
            self.model.actuators.push((actuator, e.clone()));
            return Ok(());
        };
        let joint = Some(joint).map(|name| scope.at.name(&name)).unwrap_or_default();
        // A replicated joint gets replicas of its actuators.
        for joint in self.copied.get(&joint).cloned().unwrap_or_else(|| vec![joint]) {
            actuator.joint = Some(joint);
            self.model.actuators.push((actuator.clone(), e.clone()));
        }
        Ok(())
    }
}

/// The names of two referenced objects.
fn both(e: &Element, keys: [&str; 2], scope: &Scope) -> Result<[String; 2], UrdfError> {
    let [one, other] =
        keys.map(|key| e.word(key).map(|name| if name == "world" { name.into() } else { scope.at.name(name) }));
    one.zip(other).map(|(a, b)| [a, b]).ok_or_else(|| e.refused(format!("it needs {} and {}", keys[0], keys[1])))
}
