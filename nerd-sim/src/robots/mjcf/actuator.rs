//! Actuators of an MJCF: every kind of element is a shortcut of `<general>`, and all kinds share one set of defaults.

use super::compiler::Compiler;
use super::element::Element;
use super::joint::largest;
use super::law::{Law, motor, servos};
use crate::internal::*;

/// Tags of the supported actuator elements; other tags are refused.
pub(super) const READ: [&str; 4] = ["motor", "position", "velocity", "general"];

/// Attributes that name an actuator's target.
const TARGETS: [&str; 9] =
    ["joint", "jointinparent", "tendon", "site", "slidersite", "cranksite", "body", "refsite", "cranklength"];

#[derive(Clone, Debug)]
pub(super) struct Actuator {
    /// Name of the target: of a joint, else (`tendon`) of a fixed tendon.
    pub joint: Option<String>,
    pub tendon: Option<String>,
    law: Law,
    /// Initial laws of `<position>` and `<velocity>` in this default class; `above`: in the parent class.
    servos: [Law; 2],
    above: [Law; 2],
    dynamics: String,
    /// Number of the actuator's group; `<option>` may disable groups.
    pub group: f64,
    pub gear: f64,
    control: [f64; 2],
    control_limited: Option<bool>,
    force: [f64; 2],
    force_limited: Option<bool>,
    /// Inertia (kg m^2) and damping (N m s/rad) of the actuator itself, before the gear.
    pub armature: f64,
    pub damping: f64,
    delay: f64,
}

impl Default for Actuator {
    fn default() -> Self {
        Self {
            joint: None,
            tendon: None,
            law: motor(),
            servos: servos(),
            above: servos(),
            dynamics: "none".into(),
            group: 0.0,
            gear: 1.0,
            control: [0.0; 2],
            control_limited: None,
            force: [0.0; 2],
            force_limited: None,
            armature: 0.0,
            damping: 0.0,
            delay: 0.0,
        }
    }
}

impl Actuator {
    /// Starts a nested default class, whose parent class has the present laws.
    pub fn below(&mut self) {
        self.above = self.servos.clone();
    }

    /// Applies the attributes of an actuator element; its tag selects the kind.
    pub fn apply(&mut self, e: &Element) -> Result<(), UrdfError> {
        self.joint = e.word("joint").or_else(|| e.word("jointinparent")).map(String::from);
        self.tendon = e.word("tendon").map(String::from);
        e.set("group", &mut self.group)?;
        let mut gear = [self.gear, 0.0, 0.0, 0.0, 0.0, 0.0];
        e.fill("gear", &mut gear)?;
        self.gear = gear[0];
        for (key, range, said) in [
            ("ctrl", &mut self.control, &mut self.control_limited),
            ("force", &mut self.force, &mut self.force_limited),
        ] {
            *range = e.array(&format!("{key}range"))?.unwrap_or(*range);
            *said = e.tristate(&format!("{key}limited")).unwrap_or(*said);
        }
        if e.number("inheritrange")?.is_some_and(|x| x > 0.0)
            && e.array("ctrlrange")?.is_some_and(|range: [f64; 2]| range != [0.0; 2])
        {
            return Err(e.refused("ctrlrange and inheritrange both give its range; write one"));
        }
        e.set("armature", &mut self.armature)?;
        let mut damping = [self.damping, 0.0, 0.0];
        e.fill("damping", &mut damping)?;
        if damping[1..] != [0.0; 2] {
            return Err(e.refused("damping is a polynomial; write one number, an actuator's damping here is linear"));
        }
        self.damping = damping[0];
        e.set("delay", &mut self.delay)?;
        self.apply_law(e)
    }

    /// Applies the attributes of an actuator's law.
    fn apply_law(&mut self, e: &Element) -> Result<(), UrdfError> {
        // Each shortcut starts from the class's law of its own kind, and resets the laws of other kinds to the parent
        // class's.
        let servos = std::mem::replace(&mut self.servos, self.above.clone());
        match e.tag.as_str() {
            "position" => {
                let [mut law, _] = servos;
                e.set("kp", &mut law.gain)?;
                let damping = e.number("kv")?.map(|kv| -kv).or(e.number("dampratio")?).unwrap_or(law.bias[2]);
                law = Law { gain: law.gain, ..Law::new("affine", [0.0, -law.gain, damping]) };
                self.dynamics =
                    if e.number("timeconst")?.is_some_and(|time| time != 0.0) { "filterexact" } else { "none" }.into();
                (self.servos[0], self.law) = (law.clone(), law);
            }
            "velocity" => {
                let [_, mut law] = servos;
                e.set("kv", &mut law.gain)?;
                law = Law { gain: law.gain, ..Law::new("affine", [0.0, 0.0, -law.gain]) };
                self.dynamics = "none".into();
                (self.servos[1], self.law) = (law.clone(), law);
            }
            "general" => {
                let law = &mut self.law;
                let mut gains = [law.gain, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
                e.fill("gainprm", &mut gains)?;
                let mut bias = [0.0; 10];
                bias[..3].copy_from_slice(&law.bias);
                e.fill("biasprm", &mut bias)?;
                (law.gain, law.bias) = (gains[0], [bias[0], bias[1], bias[2]]);
                for (key, kind) in [
                    ("gaintype", &mut law.gain_kind),
                    ("biastype", &mut law.bias_kind),
                    ("dyntype", &mut self.dynamics),
                ] {
                    *kind = e.word(key).map_or_else(|| std::mem::take(kind), String::from);
                }
                self.servos = [law.clone(), law.clone()];
            }
            _ => (self.law, self.dynamics) = (motor(), "none".into()),
        }
        Ok(())
    }

    /// Refuses an unsupported law.
    pub fn check(&self, e: &Element) -> Result<(), UrdfError> {
        if !READ.contains(&e.tag.as_str()) {
            return Err(e.refused(format!("only {} are read; leave it out, or write one of them", READ.join(", "))));
        }
        let targets: Vec<&str> = TARGETS.into_iter().filter(|key| e.has(key)).collect();
        if targets.len() > 1 {
            return Err(e.refused(format!("{} are its targets; write one", targets.join(" and "))));
        }
        // Refuses any `input` except a single one of these: the laws read here have one input.
        if let Some(input) =
            e.word("input").filter(|input| !["pos", "vel", "pressure", "quat", "expmap"].contains(input))
        {
            return Err(e.refused(format!("input=\"{input}\": its law has one, pos, vel or pressure")));
        }
        if self.joint.is_none() && self.tendon.is_none() {
            return Err(e.refused(
                "it acts on no joint; only actuators on joints, and on fixed tendons of one coordinate, are read",
            ));
        }
        let laws = [
            ("gaintype", &self.law.gain_kind, "fixed", "gains that depend on position or velocity are not read"),
            ("dyntype", &self.dynamics, "none", "actuators act at once here; write dyntype=\"none\", or no timeconst"),
        ];
        if let Some((key, kind, _, why)) = laws.into_iter().find(|(_, kind, known, _)| kind != known) {
            return Err(e.refused(format!("{key}=\"{kind}\" is not supported: {why}")));
        }
        if !["none", "affine"].contains(&self.law.bias_kind.as_str()) {
            return Err(e.refused(format!(
                "biastype=\"{}\" is not supported: only a position and velocity law is read",
                self.law.bias_kind
            )));
        }
        for (key, range, said) in
            [("ctrl", self.control, self.control_limited), ("force", self.force, self.force_limited)]
        {
            if said == Some(true) && range[0] >= range[1] {
                return Err(e.refused(format!("{key}range {range:?} has no width, and {key}limited is true")));
            }
        }
        if e.whole("actdim")?.is_some_and(|states| states > 0) {
            return Err(e.refused("actdim is above zero, and its law has no state; leave it out"));
        }
        if self.delay != 0.0 {
            return Err(
                e.refused("delay is not supported; leave it out, and give delays as [vary] or motors in a .toml")
            );
        }
        let [constant, kp, kd] = self.gains();
        if constant != 0.0 && self.law.gain != 0.0 {
            return Err(e.refused("a constant part of its bias is not supported; leave it out"));
        }
        if kp < 0.0 || kd < 0.0 && self.damping_ratio().is_none() {
            return Err(e.refused("its law has a negative gain, and would push away from its target"));
        }
        Ok(())
    }

    /// `[constant, kp, kd]` of the law, before the gear.
    pub fn gains(&self) -> [f64; 3] {
        let [a, b, c] = if self.law.bias_kind == "affine" { self.law.bias } else { [0.0; 3] };
        [a, -b, -c]
    }

    /// Damping ratio, if the file gives one in place of a velocity gain.
    pub fn damping_ratio(&self) -> Option<f64> {
        let [_, kp, kd] = self.gains();
        (kd < 0.0 && kp == self.law.gain).then_some(-kd)
    }

    /// Whether the law has no feedback of position or velocity, so that the force is proportional to control.
    fn plain(&self) -> bool {
        let [_, kp, kd] = self.gains();
        kp == 0.0 && kd == 0.0
    }

    /// Torque limit (N m) or force limit (N) after the gear; infinite without bounds.
    pub fn effort(&self, compiler: &Compiler) -> f64 {
        let asked = if self.plain() {
            self.law.gain.abs() * largest(self.control, self.control_limited, compiler)
        } else {
            f64::INFINITY
        };
        let most = self.gear.abs() * asked.min(largest(self.force, self.force_limited, compiler));
        if most.is_nan() { 0.0 } else { most }
    }

    /// Whether the limits of the two directions differ.
    pub fn lopsided(&self, compiler: &Compiler) -> bool {
        let uneven = |range: [f64; 2], said| {
            super::joint::limited(range, said, compiler).is_some_and(|[low, high]| low != -high)
        };
        uneven(self.force, self.force_limited) || self.plain() && uneven(self.control, self.control_limited)
    }
}
