//! Reads the joints of an MJCF.

use super::compiler::Compiler;
use super::element::Element;
use super::option::Options;
use super::placement::Placement;
use crate::internal::*;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Free,
    Ball,
    Slide,
    Hinge,
}

impl Kind {
    pub fn coordinates(self) -> usize {
        [7, 4, 1, 1][self as usize]
    }

    pub fn velocities(self) -> usize {
        [6, 3, 1, 1][self as usize]
    }
}

/// A joint. Angles are in the file's unit until [`Joint::in_si`].
#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub name: Option<String>,
    pub kind: Kind,
    pub pos: [f64; 3],
    pub axis: [f64; 3],
    pub range: [f64; 2],
    limited: Option<bool>,
    pub reference: f64,
    pub spring_reference: f64,
    /// Stiffness (N m/rad or N/m), then the coefficients of higher powers of the displacement.
    pub stiffness: [f64; 3],
    /// Damping (N m s/rad or N s/m), then the coefficients of higher powers of the velocity.
    pub damping: [f64; 3],
    /// Time constant (s) and damping ratio of the spring, in place of stiffness and damping.
    pub spring_damper: [f64; 2],
    pub armature: f64,
    pub friction: f64,
    pub effort: [f64; 2],
    /// Whether the frame of a free body without children moves to the centre of mass and the principal axes.
    pub align: bool,
    effort_limited: Option<bool>,
    /// Whether gravity compensation counts as actuator force.
    pub lifts: bool,
    /// Attributes that the file sets for the softness of limits and dry friction; they have no effect.
    pub soft: Vec<&'static str>,
}

/// Attributes that set the softness of limits and dry friction.
const SOFT: [&str; 5] = ["margin", "solreflimit", "solimplimit", "solreffriction", "solimpfriction"];

impl Default for Joint {
    fn default() -> Self {
        Self {
            name: None,
            kind: Kind::Hinge,
            pos: [0.0; 3],
            axis: [0.0, 0.0, 1.0],
            range: [0.0; 2],
            limited: None,
            reference: 0.0,
            spring_reference: 0.0,
            stiffness: [0.0; 3],
            damping: [0.0; 3],
            spring_damper: [0.0; 2],
            armature: 0.0,
            friction: 0.0,
            effort: [0.0; 2],
            align: false,
            effort_limited: None,
            lifts: false,
            soft: Vec::new(),
        }
    }
}

impl Joint {
    pub fn free(name: Option<&str>) -> Self {
        Self { name: name.map(String::from), kind: Kind::Free, ..Self::default() }
    }

    /// Expresses the joint in the frame of its body, and adds prefix and suffix to its name.
    pub fn hang(&mut self, at: &Placement) {
        self.name = self.name.take().map(|name| at.name(&name));
        self.pos = at.frame.transform_point(&self.pos.into()).coords.into();
        self.axis = (at.frame.rotation * Vector3::from(self.axis)).into();
    }

    /// Applies the attributes of a joint element.
    pub fn apply(&mut self, e: &Element) -> Result<(), UrdfError> {
        let kinds = [("free", Kind::Free), ("ball", Kind::Ball), ("slide", Kind::Slide), ("hinge", Kind::Hinge)];
        self.kind = e.one_of("type", &kinds).unwrap_or(self.kind);
        self.name = e.word("name").map(String::from);
        e.fill("stiffness", &mut self.stiffness)?;
        e.fill("damping", &mut self.damping)?;
        for (key, x) in [("pos", &mut self.pos), ("axis", &mut self.axis)] {
            *x = e.array(key)?.unwrap_or(*x);
        }
        for (key, x) in [
            ("range", &mut self.range),
            ("actuatorfrcrange", &mut self.effort),
            ("springdamper", &mut self.spring_damper),
        ] {
            *x = e.array(key)?.unwrap_or(*x);
        }
        self.limited = e.tristate("limited").unwrap_or(self.limited);
        self.effort_limited = e.tristate("actuatorfrclimited").unwrap_or(self.effort_limited);
        self.lifts = e.flag("actuatorgravcomp").unwrap_or(self.lifts);
        let said: Vec<_> = SOFT.into_iter().filter(|key| e.has(key) && !self.soft.contains(key)).collect();
        self.soft.extend(said);
        e.set("ref", &mut self.reference)?;
        e.set("springref", &mut self.spring_reference)?;
        e.set("armature", &mut self.armature)?;
        e.set("frictionloss", &mut self.friction)
    }

    /// The joint with angles in rad.
    pub fn in_si(mut self, compiler: &Compiler) -> Self {
        if self.kind == Kind::Hinge {
            self.range = self.range.map(|x| compiler.angle(x));
            (self.reference, self.spring_reference) =
                (compiler.angle(self.reference), compiler.angle(self.spring_reference));
        }
        self
    }

    /// Ends of the joint's range, if it is limited.
    pub fn limits(&self, compiler: &Compiler) -> Option<[f64; 2]> {
        limited(self.range, self.limited, compiler)
    }

    /// Properties that sensors and equalities may require of a joint.
    pub fn kinds(&self, compiler: &Compiler) -> [(&'static str, bool); 3] {
        let limited = self.kind != Kind::Free && self.limits(compiler).is_some();
        [
            ("hinge-or-slide", matches!(self.kind, Kind::Hinge | Kind::Slide)),
            ("ball-joint", self.kind == Kind::Ball),
            ("limited-joint", limited),
        ]
    }

    /// Largest total torque (N m) or force (N) of the joint's actuators.
    pub fn torque_limit(&self, compiler: &Compiler) -> f64 {
        largest(self.effort, self.effort_limited, compiler)
    }

    /// Stiffness (N m/rad or N/m) and damping (N m s/rad or N s/m) of the joint. `inertia` (kg m^2 or kg): inertia felt
    /// at the joint with all other joints free, if known.
    pub fn spring(&self, inertia: Option<f64>, options: &Options) -> (f64, f64) {
        let [time, ratio] = self.spring_damper;
        let (stiffness, damping) = match inertia {
            Some(inertia) if time > 0.0 && ratio > 0.0 => (inertia / (time * ratio).powi(2), 2.0 * inertia / time),
            _ => (self.stiffness[0], self.damping[0]),
        };
        let on = |flag: &str, x: f64| if options.is_off(flag) { 0.0 } else { x };
        (on("spring", stiffness), on("damper", damping))
    }

    /// Refuses values out of range, and unsupported attributes.
    pub fn check(&self, e: &Element) -> Result<(), UrdfError> {
        if self.kind == Kind::Ball {
            return Err(e.refused("ball joints are not supported; robots are trees of hinges and slides"));
        }
        let positive = [
            ("damping", self.damping[0]),
            ("stiffness", self.stiffness[0]),
            ("armature", self.armature),
            ("frictionloss", self.friction),
        ];
        if let Some((key, x)) = positive.into_iter().find(|(_, x)| *x < 0.0) {
            return Err(e.refused(format!("{key} is {x}, below zero")));
        }
        for (key, powers) in [("damping", self.damping), ("stiffness", self.stiffness)] {
            if powers[1..] != [0.0; 2] {
                return Err(
                    e.refused(format!("{key} is a polynomial; write one number, a joint's {key} here is linear"))
                );
            }
        }
        if e.number("springyield")?.is_some_and(|x| x > 0.0) {
            return Err(e.refused("springyield is not supported; leave it out"));
        }
        for (key, range, said) in
            [("range", self.range, self.limited), ("actuatorfrcrange", self.effort, self.effort_limited)]
        {
            if said == Some(true) && range[0] >= range[1] {
                return Err(e.refused(format!("{key} {range:?} has no width")));
            }
        }
        if self.spring_damper != [0.0; 2] && self.spring_damper.iter().any(|x| *x <= 0.0) {
            return Err(e.refused("springdamper has two numbers above zero, or is left out"));
        }
        Ok(())
    }
}

/// The range, if it is active: declared as limited, or of positive width while `autolimits` is set.
pub(super) fn limited(range: [f64; 2], limited: Option<bool>, compiler: &Compiler) -> Option<[f64; 2]> {
    let there = limited.unwrap_or(compiler.autolimits && range[0] < range[1]);
    there.then_some(range)
}

/// Largest magnitude in the range if it is active, else infinity.
pub(super) fn largest(range: [f64; 2], said: Option<bool>, compiler: &Compiler) -> f64 {
    limited(range, said, compiler).map_or(f64::INFINITY, |[low, high]| low.abs().max(high.abs()))
}
