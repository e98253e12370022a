//! A robot in its scene under a solver, with parameters set to given values.

use super::parameter::{CalibrateError, Parameter, What, round};
use crate::{articulated::numbers, internal::*, robots::motors::late, scene::PlaneSpec};

/// A solver with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// `articulated`.
    Articulated(ArticulatedConfig),
    /// rapier.
    Rapier(RapierConfig),
}

impl Engine {
    /// Builds the solver.
    pub fn solver(&self) -> Box<dyn Solver> {
        match *self {
            Self::Articulated(config) => Box::new(Articulated::new(config)),
            Self::Rapier(config) => Box::new(Rapier::new(config)),
        }
    }

    /// Sets a parameter of rapier's own; refuses parameters that mean nothing to the solver.
    fn set(&mut self, p: &Parameter, value: f64) -> Result<(), CalibrateError> {
        let foreign = match self {
            Engine::Rapier(config) if p.what == What::Restitution => {
                config.restitution = value;
                false
            }
            Engine::Rapier(_) => {
                matches!(p.what, What::Rounding | What::Stiffness | What::Damping | What::JointFriction(_))
            }
            Engine::Articulated(_) => p.what == What::Restitution,
        };
        if foreign {
            return Err(CalibrateError::Parameter(format!(
                "parameter `{}` means nothing to this solver; leave it out",
                p.name
            )));
        }
        Ok(())
    }
}

/// Sets a number of a link or joint; parameters of other kinds leave the robot as it is.
fn set_robot(system: &mut System, what: What, value: f64) {
    let robot = &mut system.robot;
    match what {
        What::Mass(link) => {
            let Link { inertia, lifted, .. } = &mut robot.links[link];
            inertia.inertia *= value / inertia.mass;
            lifted.mass *= value / inertia.mass;
            inertia.mass = value;
        }
        What::Com(link, axis) => {
            let Link { frame, inertia, lifted, .. } = &mut robot.links[link];
            let mut com = frame.inverse_transform_point(&inertia.com.into());
            com[axis] = value;
            let com = frame.transform_point(&com).coords;
            lifted.at += com - inertia.com;
            inertia.com = com;
        }
        What::Inertia(link) => robot.links[link].inertia.inertia *= value,
        What::Spread(link, axis) => {
            let Link { frame, inertia, .. } = &mut robot.links[link];
            let turn = frame.rotation.to_rotation_matrix();
            let mut own = BodyInertia { inertia: turn.inverse() * inertia.inertia * turn, ..*inertia };
            own.spread(axis, value);
            inertia.inertia = turn * own.inertia * turn.inverse();
        }
        What::Rounding => round(system, value),
        What::JointDamping(joint) => robot.joints_mut().nth(joint).into_iter().for_each(|j| j.damping = value),
        What::Armature(joint) => robot.joints_mut().nth(joint).into_iter().for_each(|j| j.armature = value),
        What::JointFriction(joint) => robot.joints_mut().nth(joint).into_iter().for_each(|j| j.friction = value),
        _ => {}
    }
}

/// A robot in a scene under a solver, to be compared with measurements.
#[derive(Clone)]
pub struct Subject {
    /// The robot.
    pub system: Arc<System>,
    /// The scene in which the robot moves.
    pub scene: Arc<Scene>,
    /// Solver and settings.
    pub engine: Engine,
    /// Frames by which measured velocities are older than their poses.
    pub lag: f64,
    /// Delay of torques (frames), 0 to 2.
    pub delay: f64,
    /// Joint positions (rad or m) where the sensors read 0.
    pub zeros: Vec<f64>,
    /// Factor on the torque of each joint.
    pub strength: Vec<f64>,
}

impl Subject {
    /// A robot with nominal parameters.
    pub fn new(system: &Arc<System>, scene: &str, engine: Engine) -> Result<Self, CalibrateError> {
        let [zeros, strength] = [0.0, 1.0].map(|value| vec![value; system.robot.joint_count()]);
        Ok(Self { scene: system.scene(scene)?, system: system.clone(), engine, lag: 0.0, delay: 0.0, zeros, strength })
    }

    /// The subject with these values of the parameters.
    pub fn with(&self, parameters: &[Parameter], values: &[f64]) -> Result<Self, CalibrateError> {
        let mut system = (*self.system).clone();
        let mut out = self.clone();
        // Scale first: other parameters use the scaled lengths.
        for (_, &value) in parameters.iter().zip(values).filter(|(p, _)| p.what == What::Size) {
            system.robot.scale(value);
            system.folds.scale(value);
        }
        for (p, &value) in parameters.iter().zip(values) {
            self.set_material(&mut system, p.what, value);
            match p.what {
                What::Gravity => {
                    let g = system.gravity();
                    system.spec.gravity = (g * (value / g.norm())).into();
                }
                What::Height => self.plane(&mut system, p)?.height += value,
                What::Tilt(axis) => self.plane(&mut system, p)?.angles[axis] += value,
                What::Lag => out.lag = value,
                What::Delay => out.delay = value,
                What::Zero(joint) => out.zeros[joint] = value,
                What::Strength(joint) => out.strength[joint] = value,
                What::Size | What::Friction | What::Stiffness | What::Damping | What::Restitution => {}
                What::Mass(_) | What::Com(..) | What::Inertia(_) | What::Spread(..) | What::Rounding => {
                    set_robot(&mut system, p.what, value)
                }
                What::JointDamping(_) | What::Armature(_) | What::JointFriction(_) => {
                    set_robot(&mut system, p.what, value)
                }
            }
            out.engine.set(p, value)?;
        }
        out.system = Arc::new(system);
        // A random scene is not built from the robot's specification, so it stays.
        if self.scene.name != "random" {
            out.scene = out.system.scene(&self.scene.name)?;
        }
        Ok(out)
    }

    /// Sets a number of the robot's material, and of the scene's material if the scene states one. Both are set, since
    /// a contact has the mean of both materials.
    fn set_material(&self, system: &mut System, what: What, value: f64) {
        let own =
            system.spec.scenes.iter_mut().filter(|s| s.name == self.scene.name).filter_map(|s| s.material.as_mut());
        for material in own.chain([&mut system.spec.material]) {
            match what {
                What::Friction => material.friction = value,
                What::Stiffness => material.stiffness = value,
                What::Damping => material.damping = value,
                _ => {}
            }
        }
        // The value also replaces friction coefficients that the robot's file sets for pairs of geoms.
        if what == What::Friction {
            system.one_friction = Some(value);
        }
    }

    /// The delayed and scaled torques of a frame; `asked` are the commanded torques of the last three frames, newest
    /// first.
    pub fn late(&self, asked: &[&[f64]; 3]) -> Vec<f64> {
        let mut out = vec![0.0; asked[0].len()];
        late(self.delay, asked, &mut out);
        out.iter_mut().zip(&self.strength).for_each(|(tau, factor)| *tau *= factor);
        out
    }

    /// Converts joint positions to sensor readings (`side` -1) or readings to joint positions (1).
    pub fn shift(&self, pose: &mut [f64], side: f64) {
        let first = self.system.robot.root_coords();
        pose[first..].iter_mut().zip(&self.zeros).for_each(|(q, zero)| *q += side * zero);
    }

    /// Derivatives `[parameter][number]` of the numbers of robot and scene ([`numbers`]) with respect to each parameter
    /// at `values`. Uses central differences, without a solver. The derivatives convert gradients with respect to
    /// numbers ([`Articulated::back_by_numbers`]) to gradients with respect to parameters.
    pub fn numbers_by(&self, parameters: &[Parameter], values: &[f64]) -> Result<Vec<Vec<f64>>, CalibrateError> {
        let by = |k: usize| {
            let size = 1e-5 * (parameters[k].high - parameters[k].low);
            let side = |size: f64| {
                let mut values = values.to_vec();
                values[k] += size;
                self.with(parameters, &values).map(|subject| numbers(&subject.system, &subject.scene))
            };
            let [up, down] = [side(size)?, side(-size)?];
            Ok(up.iter().zip(down).map(|(up, down)| (up - down) / (2.0 * size)).collect())
        };
        (0..parameters.len()).map(by).collect()
    }

    /// The plane of the scene in the system's specification; an error names the parameter if there is none.
    fn plane<'a>(&self, system: &'a mut System, p: &Parameter) -> Result<&'a mut PlaneSpec, CalibrateError> {
        let own = system.spec.scenes.iter_mut().find(|s| s.name == self.scene.name);
        own.map(|scene| &mut scene.plane).ok_or_else(|| CalibrateError::idle(&p.name))
    }
}
