//! One frame of one environment: explicit substeps, or implicit ones where they are configured or a force is too stiff.

use super::energy::{FAST_TURN_RK4, MAX_REFINED, MAX_REFINED_TERRAIN};
use super::spin::turns;
use super::stick::{AT_REST, SUBSTEPS_AT_REST};
use super::{config::Asked, config::Settings, kept::Kept, stiff::Bounds, workspace::Workspace};
use crate::drive::servos;
use crate::prelude::*;
use crate::solver::parallel::Frame;

impl Frame for Workspace {
    type Config = Settings;
    type Prepared = Bounds;
    const CHUNK: usize = 64;
    const DRIVEN: bool = true;

    fn prepare(system: &System) -> Result<Arc<Bounds>, String> {
        Ok(Arc::new(Bounds::new(system)))
    }

    fn new(system: &System, known: Arc<Bounds>) -> Self {
        Self::of(system, known)
    }

    fn turn_to(&mut self, known: &Arc<Bounds>) {
        self.stiff.bounds.clone_from(known);
    }

    fn drive(&mut self, drives: &[Drive], servo: bool) {
        self.servo = servo;
        self.drives.clear();
        self.drives.extend_from_slice(drives);
    }

    fn forces(&self) -> &[Vector3<f64>] {
        &self.forces
    }

    fn step(
        &mut self,
        system: &System,
        scene: &Scene,
        settings: &Settings,
        state: &mut [f64],
        tau: &[f64],
    ) -> Result<(), String> {
        if !self.servo {
            return self.watched(system, scene, settings, state, tau);
        }
        let mut rest = std::mem::take(&mut self.rest);
        servos(system, state, tau, &mut self.drives, &mut rest);
        let done = self.watched(system, scene, settings, state, &rest);
        self.rest = rest;
        done
    }
}

impl Workspace {
    /// Steps a frame. While the frame fails, gains energy or ends in a state that is not finite, steps it again with
    /// more substeps.
    fn watched(
        &mut self,
        system: &System,
        scene: &Scene,
        settings: &Settings,
        state: &mut [f64],
        tau: &[f64],
    ) -> Result<(), String> {
        let config = &settings.config;
        let robot = &system.robot;
        let contact = self.begin(system, scene, settings);
        self.start.copy_from_slice(state);
        let watched = config.contact_step == ContactStep::Implicit && system.stand_ins.is_empty();
        // Between faces of a shape or cells of a height field the distance jumps, and with it the energy in the
        // contact's spring.
        let mut may_gain_energy = contact && scene.colliders.iter().any(|c| c.plane.is_none());
        let mut finer = Asked { system, scene, config: *config, contact, tau };
        self.touches.mean_theta = false;
        loop {
            self.touches.velocity_factor = 1.0;
            let done = self.attempt(&finer, state);
            let lost = done.is_err() || state.iter().any(|x| !x.is_finite());
            may_gain_energy |= self.touches.may_gain_energy;
            let substeps = finer.config.substeps.max(finer.config.contact_substeps);
            let rough = scene.uneven() && self.forces.iter().any(|force| *force != Vector3::zeros());
            let finest = if rough { MAX_REFINED_TERRAIN } else { MAX_REFINED };
            if !watched || lost && substeps >= MAX_REFINED {
                return done;
            }
            let (times, left) = if lost {
                (2, 1.0)
            } else if may_gain_energy {
                self.refine(&finer, state, substeps, finest)?
            } else {
                (1, 1.0)
            };
            self.touches.mean_theta |= times > 1;
            let times = times.max(self.times_at_rest(robot, state, finer.config.contact_substeps));
            if times == 1 {
                if left == 0.0 {
                    state.copy_from_slice(&self.start);
                    self.kept.iter_mut().for_each(Kept::begin);
                }
                state[robot.nq()..].iter_mut().for_each(|v| *v *= left);
                self.touches.velocity_factor = left;
                return done;
            }
            finer.config.substeps *= times;
            finer.config.contact_substeps *= times;
            state.copy_from_slice(&self.start);
        }
    }

    /// Factor on the substeps of a frame in which a robot at rest creeps; 1 of any other frame.
    fn times_at_rest(&self, robot: &Robot, state: &[f64], substeps: usize) -> usize {
        let rates = &state[robot.nq()..];
        // The twist of a root far from the origin has a large linear part, however slowly it turns.
        let rests = || rates.iter().enumerate().all(|(k, v)| (3..robot.root_dofs()).contains(&k) || v.abs() < AT_REST);
        if self.touches.creeps && rests() { SUBSTEPS_AT_REST.div_ceil(substeps) } else { 1 }
    }

    /// Prepares materials and memory for a frame; returns whether it may have contact.
    fn begin(&mut self, system: &System, scene: &Scene, settings: &Settings) -> bool {
        self.settling = settings.settling;
        self.first_h = system.frame_time / settings.config.contact_substeps as f64;
        let robot = &system.robot;
        let contact = !scene.colliders.is_empty() && !robot.contact_points.is_empty();
        self.materials.clear();
        if contact {
            self.materials.begin(system, scene);
            let most = robot.contact_points.len() * scene.colliders.len();
            self.events.clear();
            // Room for the events of one more point, before its covered events are removed.
            self.events.reserve(most + scene.colliders.len());
            self.owners.clear();
            self.owners.reserve(most);
            self.owners.extend(0..robot.contact_points.len());
        }
        contact
    }

    /// Steps a frame once: implicitly where necessary or configured, else explicitly unless a force is too stiff.
    fn attempt(&mut self, asked: &Asked, state: &mut [f64]) -> Result<(), String> {
        let Asked { system, config, contact, .. } = *asked;
        let robot = &system.robot;
        let begin = |own: &mut Self| {
            own.data.external.fill(Wrench::default());
            own.forces.fill(Vector3::zeros());
            own.touches.work = (0.0, 0.0);
            own.touches.may_gain_energy = false;
            own.touches.creeps = false;
            own.kept.iter_mut().for_each(Kept::begin);
        };
        begin(self);
        // Only the implicit step has dry friction (stiff at rest), springs, drives and self-collision.
        if system.held() || !self.drives.is_empty() || contact && config.contact_step == ContactStep::Implicit {
            return self.implicit(asked, config.contact_substeps, state);
        }
        self.start.copy_from_slice(state);
        self.stiff.begin();
        let h = system.frame_time / config.substeps as f64;
        let rates = &state[robot.nq()..];
        self.touches.may_gain_energy = rates[robot.root_dofs()..].iter().any(|v| v.abs() * h > FAST_TURN_RK4);
        let mut finer = *asked;
        if robot.floating() && !contact && config.integrator == Integrator::Rk4 {
            let turns = turns(h * vector(rates).norm());
            self.touches.may_gain_energy |= turns > 1;
            finer.config.substeps *= turns;
        }
        if self.explicit(&finer, state)? {
            return Ok(());
        }
        // A damper, limit or friction is too stiff for explicit substeps of this length.
        state.copy_from_slice(&self.start);
        begin(self);
        self.implicit(asked, config.substeps.max(config.contact_substeps), state)
    }
}
