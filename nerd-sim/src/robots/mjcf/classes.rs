//! Default classes: the values of attributes that an element leaves out.

use std::collections::HashMap;

use super::actuator::Actuator;
use super::compiler::Compiler;
use super::element::Element;
use super::geom::{Geom, soften};
use super::joint::Joint;
use super::site::Site;
use super::values::{Value, value_of};
use crate::internal::*;
use crate::scene::Softness;

const MAIN: &str = "main";

/// The defaults of one class.
#[derive(Clone, Debug, Default)]
pub(super) struct Class {
    pub joint: Joint,
    pub geom: Geom,
    pub site: Site,
    pub actuator: Actuator,
    pub pair: Pair,
    pub mesh: MeshDefault,
    pub active: Option<bool>,
    /// Default references to other objects, and all attributes of textures, by (tag, attribute).
    pub names: HashMap<(String, String), String>,
}

/// Contact parameters that a `<pair>` sets.
#[derive(Clone, Debug, Default)]
pub(super) struct Pair {
    pub condim: Option<i64>,
    /// Two tangential, one torsional, two rolling coefficients.
    pub friction: Option<Vec<f64>>,
    pub margin: Option<f64>,
    pub softness: Option<Softness>,
}

impl Pair {
    pub fn apply(&mut self, e: &Element) -> Result<(), UrdfError> {
        self.condim = e.whole("condim")?.or(self.condim);
        self.friction = e.list("friction")?.or_else(|| self.friction.take());
        self.margin = e.number("margin")?.or(self.margin);
        if e.has("solref") || e.has("solimp") {
            soften(self.softness.get_or_insert_default(), e, ["solref", "solimp"])?;
        }
        Ok(())
    }
}

/// Defaults of meshes.
#[derive(Clone, Debug)]
pub(super) struct MeshDefault {
    pub scale: [f64; 3],
    pub inertia: String,
}

impl Default for MeshDefault {
    fn default() -> Self {
        Self { scale: [1.0; 3], inertia: "legacy".into() }
    }
}

impl MeshDefault {
    pub fn apply(&mut self, e: &Element) -> Result<(), UrdfError> {
        self.scale = e.array("scale")?.unwrap_or(self.scale);
        self.inertia = e.word("inertia").map_or_else(|| std::mem::take(&mut self.inertia), String::from);
        Ok(())
    }
}

pub(super) struct Classes(HashMap<String, Class>);

impl Classes {
    pub fn read(root: &Element, compiler: &Compiler) -> Result<Self, UrdfError> {
        let mut own = Self(HashMap::from([(MAIN.to_string(), Class::default())]));
        for top in root.all("default") {
            if let Some(other) = top.word("class").filter(|class| *class != MAIN) {
                return Err(
                    top.refused(format!("the outermost class is `{MAIN}`; put `{}` into it", other.escape_debug()))
                );
            }
            own.add(top, MAIN, MAIN, compiler)?;
        }
        Ok(own)
    }

    /// Adds a class from its element, starting from its parent class, and its nested classes.
    fn add(&mut self, e: &Element, name: &str, above: &str, compiler: &Compiler) -> Result<(), UrdfError> {
        let mut class = self.0.get(above).cloned().unwrap_or_default();
        class.actuator.below();
        for child in &e.children {
            let named = |(key, _): &&(String, String)| {
                child.tag == "texture" || matches!(value_of(&child.tag, key), Value::Named(_))
            };
            class.names.extend(
                child
                    .attributes
                    .iter()
                    .filter(named)
                    .map(|(key, text)| ((child.tag.clone(), key.clone()), text.clone())),
            );
            match child.tag.as_str() {
                "joint" => class.joint.apply(child)?,
                "geom" => class.geom.apply(child, compiler)?,
                "site" => class.site.apply(child, compiler)?,
                "pair" => class.pair.apply(child)?,
                "mesh" => class.mesh.apply(child)?,
                "equality" => class.active = child.flag("active").or(class.active),
                "default" | "camera" | "light" | "material" | "texture" | "tendon" => {}
                _ => class.actuator.apply(child)?,
            }
        }
        self.0.insert(name.into(), class);
        for nested in e.all("default") {
            let Some(own) = nested.word("class") else {
                return Err(nested.refused("a nested <default> needs a class"));
            };
            if self.0.contains_key(own) {
                return Err(nested.refused("another class has that name, too"));
            }
            self.add(nested, own, name, compiler)?;
        }
        Ok(())
    }

    pub fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// Class of an element: its own, else the class of the enclosing bodies.
    pub fn of(&self, e: &Element, around: Option<&str>) -> Result<&Class, UrdfError> {
        let name = e.text("class").or(around).unwrap_or(MAIN);
        self.0.get(name).ok_or_else(|| e.refused(format!("there is no default class `{}`", name.escape_debug())))
    }
}
