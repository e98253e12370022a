//! One frame of one environment: explicit substeps, or implicit ones where they are asked for or something is too stiff.

use super::energy::{FINEST, ROUGHEST, WHIRL_RK4};
use super::spin::turns;
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

    fn step(&mut self, system: &System, scene: &Scene, settings: &Settings, state: &mut [f64], tau: &[f64]) -> Result<(), String> {
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
    /// A frame that gives no energy.
    fn watched(&mut self, system: &System, scene: &Scene, settings: &Settings, state: &mut [f64], tau: &[f64]) -> Result<(), String> {
        let config = &settings.config;
        self.settling = settings.settling;
        self.whole = system.frame_time / config.contact_substeps as f64;
        let robot = &system.robot;
        let contact = !scene.colliders.is_empty() && !robot.contact_points.is_empty();
        self.materials.clear();
        if contact {
            self.materials.begin(system, scene);
            let most = robot.contact_points.len() * scene.colliders.len();
            self.events.clear();
            // As many again are held for a moment while the covered ones are left out.
            self.events.reserve(most + scene.colliders.len());
            self.owners.clear();
            self.owners.reserve(most);
            self.owners.extend(0..robot.contact_points.len());
        }
        self.start.copy_from_slice(state);
        let watched = config.contact_step == ContactStep::Implicit && system.stand_ins.is_empty();
        let finest = if scene.uneven() { ROUGHEST } else { FINEST };
        let (mut finer, mut eventful) = (Asked { system, scene, config: *config, contact, tau }, false);
        loop {
            self.touches.even = finer.config != *config;
            let done = self.attempt(&finer, state);
            eventful |= self.touches.eventful;
            let substeps = finer.config.substeps.max(finer.config.contact_substeps);
            if !watched || substeps >= if done.is_ok() { finest } else { FINEST } {
                return done;
            }
            let times = match done {
                Ok(()) if eventful => self.refine(&finer, state, substeps, finest)?,
                Ok(()) => 1,
                Err(_) => 2,
            };
            if times == 1 {
                return done;
            }
            finer.config.substeps *= times;
            finer.config.contact_substeps *= times;
            state.copy_from_slice(&self.start);
        }
    }

    /// Dry friction is stiff at rest, and a spring, a drive or a link on another may be: the implicit step alone holds them.
    fn stays_implicit(&self, system: &System) -> bool {
        system.held() || !self.drives.is_empty()
    }

    /// A frame by the steps that it asks for.
    fn attempt(&mut self, asked: &Asked, state: &mut [f64]) -> Result<(), String> {
        let Asked { system, config, contact, .. } = *asked;
        let robot = &system.robot;
        let begin = |own: &mut Self| {
            own.data.external.fill(Wrench::default());
            own.forces.fill(Vector3::zeros());
            (own.touches.work, own.touches.eventful) = ((0.0, 0.0), false);
            own.kept.iter_mut().for_each(Kept::begin);
        };
        begin(self);
        if self.stays_implicit(system) || contact && config.contact_step == ContactStep::Implicit {
            return self.implicit(asked, config.contact_substeps, state);
        }
        self.start.copy_from_slice(state);
        self.stiff.begin();
        let (h, rates) = (system.frame_time / config.substeps as f64, &state[robot.nq()..]);
        self.touches.eventful = rates[robot.root_dofs()..].iter().any(|v| v.abs() * h > WHIRL_RK4);
        let mut finer = *asked;
        if robot.floating() && !contact && config.integrator == Integrator::Rk4 {
            finer.config.substeps *= turns(h * vector(rates).norm());
        }
        if self.explicit(&finer, state)? {
            return Ok(());
        }
        // A damper, a limit or a friction was met that no explicit substep of this length can bear.
        state.copy_from_slice(&self.start);
        begin(self);
        self.implicit(asked, config.substeps.max(config.contact_substeps), state)
    }
}
