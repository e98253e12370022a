//! One frame of one environment: explicit substeps, or implicit ones where they are asked for or something is too stiff.

use super::energy::{FINEST, WHIRL_RK4};
use super::{config::Asked, config::Settings, kept::Kept, stiff::Bounds, workspace::Workspace};
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

    fn drive(&mut self, drives: &[Drive]) {
        self.drives.clear();
        self.drives.extend_from_slice(drives);
    }

    fn forces(&self) -> &[Vector3<f64>] {
        &self.forces
    }

    fn step(&mut self, system: &System, scene: &Scene, settings: &Settings, state: &mut [f64], tau: &[f64]) -> Result<(), String> {
        let config = &settings.config;
        self.settling = settings.settling;
        let robot = &system.robot;
        let contact = !scene.colliders.is_empty() && !robot.contact_points.is_empty();
        self.materials.clear();
        if contact {
            self.materials.extend(scene.colliders.iter().map(|c| c.material.mean(&system.spec.material)));
            let most = robot.contact_points.len() * scene.colliders.len();
            self.events.clear();
            // As many again are held for a moment while the covered ones are left out.
            self.events.reserve(most + scene.colliders.len());
            self.owners.clear();
            self.owners.reserve(most);
            self.owners.extend(0..robot.contact_points.len());
        }
        self.start.copy_from_slice(state);
        let watched = config.contact_step == ContactStep::Implicit && system.stand_ins.is_empty() && system.folds.is_empty();
        let (mut finer, mut eventful) = (Asked { system, scene, config: *config, contact, tau }, false);
        loop {
            self.touches.even = finer.config != *config;
            let done = self.attempt(&finer, state);
            eventful |= self.touches.eventful;
            let substeps = finer.config.substeps.max(finer.config.contact_substeps);
            if !watched || substeps >= FINEST {
                return done;
            }
            let times = match done {
                Ok(()) if eventful => self.refine(&finer, state, substeps)?,
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
}

impl Workspace {
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
        let h = system.frame_time / config.substeps as f64;
        self.touches.eventful = state[robot.nq() + robot.root_dofs()..].iter().any(|v| v.abs() * h > WHIRL_RK4);
        if self.explicit(asked, state)? {
            return Ok(());
        }
        // A damper, a limit or a friction was met that no explicit substep of this length can bear.
        state.copy_from_slice(&self.start);
        begin(self);
        self.implicit(asked, config.substeps.max(config.contact_substeps), state)
    }
}
