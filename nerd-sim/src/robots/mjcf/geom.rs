//! Reads the geoms of an MJCF.

use super::compiler::{Compiler, MIN_LENGTH, between};
use super::element::Element;
use super::placement::Placement;
use crate::internal::*;
use crate::scene::Softness;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Type {
    Plane,
    HeightField,
    Sphere,
    Capsule,
    Ellipsoid,
    Cylinder,
    Box,
    Mesh,
    Sdf,
}

pub(super) const TYPES: [(&str, Type); 9] = [
    ("plane", Type::Plane),
    ("hfield", Type::HeightField),
    ("sphere", Type::Sphere),
    ("capsule", Type::Capsule),
    ("ellipsoid", Type::Ellipsoid),
    ("cylinder", Type::Cylinder),
    ("box", Type::Box),
    ("mesh", Type::Mesh),
    ("sdf", Type::Sdf),
];

/// Applies the softness attributes of an element.
pub(super) fn soften(own: &mut Softness, e: &Element, [solref, solimp]: [&str; 2]) -> Result<(), UrdfError> {
    e.fill(solref, &mut own.solref)?;
    e.fill(solimp, &mut own.solimp)
}

#[derive(Clone, Debug)]
pub(super) struct Geom {
    pub name: Option<String>,
    pub kind: Type,
    pub size: [f64; 3],
    pub fromto: Option<[f64; 6]>,
    pub pose: Isometry3<f64>,
    pub mesh: Option<String>,
    /// Name of the height field.
    pub field: Option<String>,
    /// Factor on the sizes of a primitive fitted to a mesh.
    pub fit: f64,
    pub mass: Option<f64>,
    pub density: f64,
    pub shell: bool,
    pub group: f64,
    pub contype: u32,
    pub conaffinity: u32,
    pub condim: i64,
    pub priority: i64,
    pub friction: [f64; 3],
    pub solmix: f64,
    pub softness: Softness,
    pub margin: f64,
    pub gap: f64,
}

impl Default for Geom {
    fn default() -> Self {
        Self {
            name: None,
            kind: Type::Sphere,
            size: [0.0; 3],
            fromto: None,
            pose: Isometry3::identity(),
            mesh: None,
            field: None,
            fit: 1.0,
            mass: None,
            density: 1000.0,
            shell: false,
            group: 0.0,
            contype: 1,
            conaffinity: 1,
            condim: 3,
            priority: 0,
            friction: [1.0, 0.005, 0.0001],
            solmix: 1.0,
            softness: Softness::default(),
            margin: 0.0,
            gap: 0.0,
        }
    }
}

/// Refuses sizes that are not positive where the type needs them, and a segment with coincident ends.
pub(super) fn sized(
    e: &Element,
    kind: Type,
    size: &[f64; 3],
    fitted: bool,
    ends: Option<(&[f64; 6], &Isometry3<f64>)>,
) -> Result<(), UrdfError> {
    let long = matches!(kind, Type::Capsule | Type::Cylinder | Type::Box | Type::Ellipsoid);
    let moved = |pose: &Isometry3<f64>| pose.translation.vector != Vector3::zeros();
    if ends.is_some_and(|(ends, pose)| !long || moved(pose) || 2.0 * between(ends).1 < MIN_LENGTH) {
        return Err(e.refused(
            "fromto is for capsules, cylinders, boxes and ellipsoids, in place of pos, and its ends are apart",
        ));
    }
    let needed = match kind {
        Type::Sphere => 1,
        Type::Capsule | Type::Cylinder => 2,
        Type::Box | Type::Ellipsoid => 3,
        _ => 0,
    };
    // With `fromto`, only `size[0]` is needed: the radius or half width.
    let needed = if fitted { 0 } else { needed.min(if ends.is_some() { 1 } else { 3 }) };
    if size[..needed].iter().any(|x| *x <= 0.0) || kind == Type::Plane && size[2] <= 0.0 {
        return Err(e.refused(format!("size {size:?}: numbers above zero are needed for its type")));
    }
    Ok(())
}

impl Geom {
    /// Applies the attributes of a geom element.
    pub fn apply(&mut self, e: &Element, compiler: &Compiler) -> Result<(), UrdfError> {
        self.name = e.word("name").map(String::from);
        self.kind = e.one_of("type", &TYPES).unwrap_or(self.kind);
        e.fill("size", &mut self.size)?;
        self.fromto = e.array("fromto")?.or(self.fromto);
        compiler.pose(e, &mut self.pose)?;
        self.mesh = e.word("mesh").map(String::from).or_else(|| self.mesh.take());
        self.field = e.word("hfield").map(String::from).or_else(|| self.field.take());
        e.set("fitscale", &mut self.fit)?;
        self.mass = e.number("mass")?.or(self.mass);
        e.set("density", &mut self.density)?;
        self.shell = e.flag("shellinertia").unwrap_or(self.shell);
        e.set("group", &mut self.group)?;
        for (key, bits) in [("contype", &mut self.contype), ("conaffinity", &mut self.conaffinity)] {
            *bits = e.whole(key)?.map_or(*bits, |x| x as i32 as u32);
        }
        self.condim = e.whole("condim")?.unwrap_or(self.condim);
        self.priority = e.whole("priority")?.unwrap_or(self.priority);
        e.fill("friction", &mut self.friction)?;
        e.set("solmix", &mut self.solmix)?;
        soften(&mut self.softness, e, ["solref", "solimp"])?;
        e.set("margin", &mut self.margin)?;
        e.set("gap", &mut self.gap)
    }

    /// Refuses sizes, masses and contact parameters that MuJoCo refuses, and unsupported ones.
    pub fn check(&self, e: &Element) -> Result<(), UrdfError> {
        sized(e, self.kind, &self.size, self.mesh.is_some(), self.fromto.as_ref().map(|ends| (ends, &self.pose)))?;
        if self.mass.is_some_and(|mass| mass < 0.0) || self.density < 0.0 {
            return Err(e.refused("its mass or density is below zero"));
        }
        if ![1, 3, 4, 6].contains(&self.condim) {
            return Err(e.refused(format!("condim is {}; it is 1, 3, 4 or 6", self.condim)));
        }
        let says = |key: &&str| e.text(key).is_some_and(|text| text.split_whitespace().any(|x| x.parse() != Ok(0.0)));
        if let Some(key) = ["adhesion", "surfacevel"].iter().find(|key| says(key)) {
            return Err(e.refused(format!("{key} is not supported; leave it out")));
        }
        if self.mesh.is_none() && self.kind == Type::Mesh {
            return Err(e.refused("it names no mesh"));
        }
        if self.field.is_none() && self.kind == Type::HeightField {
            return Err(e.refused("it names no hfield"));
        }
        Ok(())
    }

    /// Expresses the geom in the frame of its body, and adds prefix and suffix to its names.
    pub fn hang(&mut self, at: &Placement) {
        self.name = self.name.take().map(|name| at.name(&name));
        self.mesh = self.mesh.take().map(|name| format!("{}{name}", at.prefix));
        self.field = self.field.take().map(|name| format!("{}{name}", at.prefix));
        (self.pose, self.size) = self.placed();
        (self.pose, self.fromto) = (at.frame * self.pose, None);
    }

    /// Pose and sizes (m), computed from the segment's ends if given: radius and half length for capsules and
    /// cylinders, half edges for other types.
    fn placed(&self) -> (Isometry3<f64>, [f64; 3]) {
        let Some(ends) = &self.fromto else { return (self.pose, self.size) };
        let (pose, half) = between(ends);
        let radius = self.size[0];
        let long = matches!(self.kind, Type::Capsule | Type::Cylinder);
        (pose, if long { [radius, half, 0.0] } else { [radius, radius, half] })
    }
}
