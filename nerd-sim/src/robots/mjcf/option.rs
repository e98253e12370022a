//! Options of an MJCF that affect the robot's motion.

use super::element::Element;
use super::geom::soften;
use crate::internal::*;
use crate::scene::Softness;

/// Features of MuJoCo that a file may disable and that affect a robot.
const FLAGS: [&str; 9] =
    ["contact", "limit", "frictionloss", "equality", "spring", "damper", "actuation", "constraint", "gravity"];

#[derive(Debug)]
pub(super) struct Options {
    pub gravity: [f64; 3],
    /// Time step (s).
    pub step: f64,
    /// Those of [`FLAGS`] that the file disables.
    off: Vec<&'static str>,
    /// Parameters that override those of every contact, if the file switches this on.
    pub contact: Option<Contact>,
    /// Whether bodies collide with their parents.
    pub parents: bool,
    pub elliptic: bool,
    pub impratio: f64,
    /// Groups of disabled actuators.
    pub groups: Vec<f64>,
}

/// Parameters that override those of every contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    pub margin: f64,
    pub softness: Softness,
    pub friction: [f64; 5],
}

impl Default for Options {
    fn default() -> Self {
        Self {
            gravity: [0.0, 0.0, -9.81],
            step: 0.002,
            off: Vec::new(),
            contact: None,
            parents: false,
            elliptic: false,
            impratio: 1.0,
            groups: Vec::new(),
        }
    }
}

impl Options {
    /// Reads all `<option>` elements of a file; later ones override.
    pub fn read(root: &Element) -> Result<Self, UrdfError> {
        let mut own = Self::default();
        let mut contact =
            Contact { margin: 0.0, softness: Softness::default(), friction: [1.0, 1.0, 0.005, 0.0001, 0.0001] };
        let mut overrides = false;
        for e in root.all("option") {
            own.gravity = e.array("gravity")?.unwrap_or(own.gravity);
            e.set("timestep", &mut own.step)?;
            e.set("impratio", &mut own.impratio)?;
            own.groups = e.list("actuatorgroupdisable")?.unwrap_or(own.groups);
            own.elliptic = e.one_of("cone", &[("pyramidal", false), ("elliptic", true)]).unwrap_or(own.elliptic);
            e.set("o_margin", &mut contact.margin)?;
            soften(&mut contact.softness, e, ["o_solref", "o_solimp"])?;
            e.fill("o_friction", &mut contact.friction)?;
            for key in ["density", "viscosity"] {
                if e.number(key)?.is_some_and(|x| x != 0.0) {
                    return Err(
                        e.refused(format!("{key} is not supported, since robots move in no medium; leave it out"))
                    );
                }
            }
            for flags in e.all("flag") {
                let on = |key: &str| flags.one_of(key, &[("enable", true), ("disable", false)]);
                for flag in FLAGS {
                    match on(flag) {
                        Some(true) => own.off.retain(|off| *off != flag),
                        Some(false) => own.off.push(flag),
                        None => {}
                    }
                }
                overrides = on("override").unwrap_or(overrides);
                own.parents = on("filterparent").map_or(own.parents, |on| !on);
            }
        }
        if own.is_off("gravity") {
            own.gravity = [0.0; 3];
        }
        own.contact = overrides.then_some(contact);
        Ok(own)
    }

    pub fn is_off(&self, flag: &str) -> bool {
        self.off.contains(&flag)
    }
}
