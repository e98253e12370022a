//! Gradients of a frame, as vector-Jacobian products (`docs/gradients.md`). The frame is stepped and recorded, then its
//! substeps are differentiated from the last to the first.

mod contact;
mod contact_force;
mod contact_law;
mod explicit;
mod inv_mass;
mod law;
mod laws;
mod numbers;
mod row;
mod stage;
mod turn;

use laws::Place;
use nerd_core::dynamics::{crba, motions, motions_back};
use numbers::Numbers;
pub use numbers::numbers;
use row::Row;

use super::{config::Settings, kept::Step, memory::Memory, spin::kinematics_about_com, workspace::Workspace};
use crate::drive::servos_back;
use crate::prelude::*;
use crate::solver::Gradients;
use crate::solver::parallel::{Back, Frame};

/// Refuses settings, robots and scenes without gradients.
pub(super) fn covered(config: &ArticulatedConfig, batch: &Batch) -> Result<(), StepError> {
    let systems = || std::iter::once(&batch.system).chain(&batch.systems);
    let rim = |point: &ContactPoint| matches!(point.locus, Locus::Rim { .. });
    let touch = batch.scenes.iter().any(|scene| !scene.colliders.is_empty());
    let missing = if systems().any(|s| !s.folds.is_empty()) {
        "a robot whose links touch each other (self_collision) has no gradients yet: leave it off"
    } else if systems().any(|s| !s.stand_ins.is_empty()) {
        "a robot whose mass matrix is paired as the reference's (stand_ins) has no gradients: take its other specification"
    } else if touch && systems().any(|s| s.robot.contact_points.iter().any(rim)) {
        "contact points that run round a rim have no gradients yet: give the robot [[contact]] points"
    } else if config.integrator == Integrator::SymplecticEuler || touch && config.contact_step == ContactStep::Explicit
    {
        "symplectic Euler has no gradients: take ArticulatedConfig::accurate or implicit"
    } else {
        return Ok(());
    };
    Err(StepError::Refused(missing.into()))
}

impl Back for Workspace {
    fn back(
        &mut self,
        system: &System,
        scene: &Scene,
        settings: &Settings,
        state: &[f64],
        tau: &[f64],
        grad_next: &[f64],
        numbers: bool,
    ) -> Result<Gradients, String> {
        let robot = &system.robot;
        let mut next = state.to_vec();
        let mut memory = self.back.take().unwrap_or_else(|| Box::new(Memory::new(robot)));
        self.kept = Some(std::mem::take(&mut memory.kept));
        let stepped = self.step(system, scene, settings, &mut next, tau);
        let kept = self.kept.take().unwrap_or_default();
        stepped?;
        let place = Place { system, scene, friction: settings.config.friction };
        let begin = |grad_next| {
            Row::begin(robot, &next, grad_next, self.touches.weights.len(), Numbers::new(robot, scene, numbers))
        };
        let mut rows: Vec<Row> = grad_next.chunks_exact(2 * robot.nv()).map(begin).collect();
        // The factor that removes gained energy counts as constant.
        rows.iter_mut().flat_map(|row| &mut row.speed).for_each(|by| *by *= self.touches.velocity_factor);
        if kept.flights().is_empty() {
            rows.iter_mut().for_each(|row| row.centre(robot, &next, -1.0));
            self.back_implicit(place, &kept.steps, &mut rows, &mut memory);
            rows.iter_mut().for_each(|row| row.centre(robot, state, 1.0));
        } else {
            rows.iter_mut().for_each(|row| row.back_flights(place, kept.flights(), &mut memory));
        }
        memory.kept = kept;
        self.back = Some(memory);
        let mut out = Gradients { next, ..Gradients::default() };
        for mut row in rows {
            let mut by_state = row.end(robot, state);
            if self.servo {
                servos_back(system, &row.drives, &mut by_state, &mut row.torque);
            }
            out.states.extend(by_state);
            out.torques.extend(row.torque);
            out.numbers.extend(row.numbers.values);
        }
        Ok(out)
    }
}

impl Workspace {
    /// Backward pass over implicit substeps.
    fn back_implicit(&mut self, place: Place, steps: &[Step], rows: &mut [Row], memory: &mut Memory) {
        let robot = &place.system.robot;
        self.data.external.fill(Wrench::default());
        for (number, step) in steps.iter().enumerate().rev() {
            let before = &steps[..number];
            let h = step.h;
            let Some(last) = step.stages.last() else { continue };
            let end: Vec<f64> = step.qd.iter().zip(&last.rate).map(|(v, a)| v + h * a).collect();
            kinematics_about_com(robot, &step.q, &mut self.data);
            crba(robot, &mut self.data);
            motions(robot, &step.qd, &self.data, &mut memory.starts);
            let mut after: Vec<Vec<f64>> = Vec::new();
            let mut held: Vec<Vec<Motion>> = Vec::new();
            for row in rows.iter_mut() {
                if step.lost {
                    // Two halves replaced a lost substep from its start: only its rate has a gradient, its end pose has
                    // none.
                    after.push(std::mem::replace(&mut row.pose, vec![0.0; robot.nv()]));
                    held.push(row.held.clone());
                    row.held.fill(Motion::default());
                } else {
                    row.drift(robot, &end, 0.5 * h);
                    row.rate.iter_mut().zip(&row.speed).for_each(|(a, v)| *a += h * v);
                }
                row.loads.fill(Wrench::default());
                row.starts.fill(Wrench::default());
                row.way = Vector3::zeros();
            }
            for stage in step.stages.iter().rev() {
                self.back_stage(place, step, stage, rows, memory);
            }
            for row in rows.iter_mut() {
                row.held.iter_mut().zip(&mut row.begun).for_each(|(held, begun)| *held += std::mem::take(begun));
            }
            self.inv_mass_adjoint(place, step, before, rows, memory);
            for row in rows.iter_mut().rev() {
                motions_back(robot, &self.data, &step.qd, &mut row.starts, &mut row.loads, &mut row.speed);
                row.unload(robot, &self.data, true);
                row.drift(robot, &step.qd, 0.5 * h);
                let (after, held) = (after.pop(), held.pop());
                row.held.iter_mut().zip(held.iter().flatten()).for_each(|(sum, by)| *sum += *by);
                row.pose.iter_mut().zip(after.iter().flatten()).for_each(|(p, a)| *p += a);
                if before.iter().all(|step| step.lost) {
                    // The first substep has no predicted rate.
                    row.rate.fill(0.0);
                }
            }
        }
    }
}
