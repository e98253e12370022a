//! Times our own solvers, and compares them with the reference.

use nerd_sim::instruments::{Recorder, Replay};

use super::plan::{Method, Plan};
use super::shown::{ChartData, Point};
use crate::prelude::*;
#[cfg(feature = "cuda")]
use nerd_cli::experiments::card;
use nerd_train::{cost::timed, spec::Method as Stepping};

type Frames = Vec<Vec<f64>>;

/// Measures the points of every method; also returns the frames of the reference.
pub(super) fn all(plan: &Plan, most: usize) -> Result<(ChartData, Frames)> {
    let Plan { system, scene, methods, .. } = plan;
    let implicit = plan.contact() || plan.implicit;
    let (finest, reference) = if implicit { (4 * most, "articulated, implicit") } else { (128, "articulated, RK4") };
    let exact = |n: usize| SolverSpec::articulated(if implicit { Stepping::Implicit } else { Stepping::Rk4 }, n);
    let bar = bar("solvers", methods.len() as u64 + 1);
    let mut converged = Recorder::new(exact(finest).solver(system, 1)?);
    let base = plan.errors(&mut converged, &mut *exact(finest / 2).solver(system, 1)?)?;
    let converged = converged.frames;
    let [reference_error, hold] = [&base.error, &base.hold].map(|x| mean(x));
    bounds::figures(&format!("{reference}: its mean error"), &[reference_error, hold])?;
    let mut points = Vec::new();
    for (k, method) in methods.iter().enumerate() {
        bar.set(k as u64 + 1);
        bar.say(&method.spec.to_string());
        let theirs = method.own.map(|own| recorded(plan, own.solver(system), &converged)).transpose()?;
        let theirs = theirs.as_ref().unwrap_or(&converged);
        let compare = |solver: &mut dyn Solver| plan.errors(&mut Replay::new(theirs), solver);
        for (series, found) in each(plan, method, &compare) {
            let Method { spec, own, .. } = method;
            let point = found.and_then(|timed| {
                let mut point = Point::new(&series, spec.asked(), timed, own.is_some());
                bounds::figures("its mean error", &[point.error])?;
                point.spec = Some(spec.clone());
                Ok(point)
            });
            match point {
                Ok(point) => points.push(point),
                Err(error) => bar.line(&format!("{spec}: left out, {error}")),
            }
        }
    }
    bar.finish();
    let data = ChartData {
        robot: system.name.clone(),
        scene: scene.name.clone(),
        protocol: plan.protocol,
        reference: format!("{reference}, {finest} substeps"),
        reference_error,
        hold,
        points,
        mujoco: None,
        environments: plan.environments,
    };
    Ok((data, converged))
}

/// Measures a method's errors and time; on a GPU, as one series for each number format.
fn each(
    plan: &Plan,
    Method { spec, series, .. }: &Method,
    compare: &dyn Fn(&mut dyn Solver) -> Result<PassiveReport, StepError>,
) -> Vec<(String, Result<Timed>)> {
    #[cfg(feature = "cuda")]
    if let Some(n) = plan.environments {
        let begun = plan.begun();
        let held = plan.protocol.held(&plan.system);
        let timed = |precision| card::timed(&begun, spec, precision, [n, plan.protocol.steps], held.as_ref(), compare);
        let one = |(precision, word): &(_, &str)| (format!("{series}{word}"), timed(*precision));
        return card::arithmetics(spec).iter().map(one).collect();
    }
    let PassiveConfig { starts, steps, .. } = plan.protocol;
    let found = spec.solver(&plan.system, starts).map_err(Error::from).and_then(|solver| {
        let (report, microseconds) = timed(solver, starts * steps, compare)?;
        Ok(Timed { report, microseconds, memory: None })
    });
    vec![(series.clone(), found)]
}

fn recorded(plan: &Plan, truth: Box<dyn Solver>, idle: &[Vec<f64>]) -> Result<Frames> {
    let mut truth = Recorder::new(truth);
    plan.errors(&mut truth, &mut Replay::new(idle))?;
    Ok(truth.frames)
}
