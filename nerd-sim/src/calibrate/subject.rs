//! A robot in its scene under a solver, with parameters set.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::error::CalibrateError;
use super::parameter::{Parameter, What, round};
use crate::articulated::{Articulated, ArticulatedConfig};
#[cfg(feature = "rapier")]
use crate::rapier::{Rapier, RapierConfig};
use crate::scene::PlaneSpec;
use crate::scene::Scene;
use crate::solver::Solver;
use crate::system::System;

/// A solver and its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// `articulated`.
    Articulated(ArticulatedConfig),
    /// rapier.
    #[cfg(feature = "rapier")]
    Rapier(RapierConfig),
}

impl Engine {
    /// The solver.
    pub fn solver(&self) -> Box<dyn Solver> {
        match *self {
            Self::Articulated(config) => Box::new(Articulated::new(config)),
            #[cfg(feature = "rapier")]
            Self::Rapier(config) => Box::new(Rapier::new(config)),
        }
    }
}

/// What is compared with measurements.
#[derive(Clone)]
pub struct Subject {
    /// The robot.
    pub system: Arc<System>,
    /// Where it is.
    pub scene: Arc<Scene>,
    /// What moves it.
    pub engine: Engine,
    /// Frames by which measured velocities are older than their poses.
    pub lag: f64,
}

impl Subject {
    /// A robot as its files have it.
    ///
    /// # Errors
    /// If it has no such scene.
    pub fn new(system: &Arc<System>, scene: &str, engine: Engine) -> Result<Self, CalibrateError> {
        // A draft uses the material of the robot's data scene, which is the scene of the measurements.
        let mut own = (**system).clone();
        own.spec.data_scene = Some(scene.into());
        Ok(Self { scene: system.scene(scene)?, system: own.into(), engine, lag: 0.0 })
    }

    /// The same with these values of the parameters.
    ///
    /// # Errors
    /// A parameter that the engine does not have.
    pub fn with(&self, parameters: &[Parameter], values: &[f64]) -> Result<Self, CalibrateError> {
        let (mut system, mut engine, mut lag) = ((*self.system).clone(), self.engine, self.lag);
        // Before everything that is in metres.
        for (_, &value) in parameters.iter().zip(values).filter(|(p, _)| p.what == What::Size) {
            system.robot.scale(value);
        }
        for (p, &value) in parameters.iter().zip(values) {
            // The robot's material, and the scene's own if it has one: a pair acts with their mean.
            let own = system.spec.scenes.iter_mut().filter(|s| s.name == self.scene.name).filter_map(|s| s.material.as_mut());
            for material in own.chain([&mut system.spec.material]) {
                match p.what {
                    What::Friction => material.friction = value,
                    What::Stiffness => material.stiffness = value,
                    What::Damping => material.damping = value,
                    What::FrictionDamping => material.friction_damping = value,
                    _ => {}
                }
            }
            match p.what {
                What::Size | What::Friction | What::Stiffness | What::Damping | What::FrictionDamping => {}
                What::Mass(link) => {
                    let inertia = &mut system.robot.links[link].inertia;
                    inertia.inertia *= value / inertia.mass;
                    inertia.mass = value;
                }
                What::Com(link, axis) => system.robot.links[link].inertia.com[axis] = value,
                What::Inertia(link) => system.robot.links[link].inertia.inertia *= value,
                What::Spread(link, axis) => system.robot.links[link].inertia.spread(axis, value),
                What::Rounding => round(&mut system, value),
                What::Gravity => {
                    let g = system.gravity();
                    system.spec.gravity = (g * (value / g.norm())).into();
                }
                What::Height | What::Tilt(_) => {}
                What::Lag => lag = value,
                What::JointDamping(joint) => system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.damping = value),
                What::JointFriction(joint) => system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.friction = value),
                #[cfg(feature = "rapier")]
                What::Restitution => match &mut engine {
                    Engine::Rapier(config) => config.restitution = value,
                    Engine::Articulated(_) => return Err(CalibrateError::Engine(p.name.clone())),
                },
                #[cfg(not(feature = "rapier"))]
                What::Restitution => return Err(CalibrateError::Engine(p.name.clone())),
            }
            #[cfg(feature = "rapier")]
            if matches!(
                (engine, p.what),
                (Engine::Rapier(_), What::Rounding | What::Stiffness | What::Damping | What::FrictionDamping | What::JointFriction(_))
            ) {
                return Err(CalibrateError::Engine(p.name.clone()));
            }
        }
        for (p, &value) in parameters.iter().zip(values) {
            let change: fn(&mut PlaneSpec, f64) = match p.what {
                What::Height => |plane, x| plane.height += x,
                What::Tilt(0) => |plane, x| plane.angles[0] += x,
                What::Tilt(_) => |plane, x| plane.angles[1] += x,
                _ => continue,
            };
            match system.spec.scenes.iter_mut().find(|s| s.name == self.scene.name) {
                Some(scene) => change(&mut scene.plane, value),
                None => return Err(CalibrateError::Nothing(p.name.clone())),
            }
        }
        let system = Arc::new(system);
        Ok(Self { scene: system.scene(&self.scene.name)?, system, engine, lag })
    }
}
