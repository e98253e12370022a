//! Times our own solvers, and compares them with the reference.

use super::plan::{Method, Plan};
use super::shown::{ChartData, Point};
use crate::prelude::*;
#[cfg(feature = "cuda")]
use nerd_cli::experiments::card;
use nerd_train::{comparison::Comparison, cost::timed, spec::Method as Stepping};

/// Measures the points of every method; also returns the comparison with the reference.
pub(super) fn all(plan: &Plan, most: usize) -> Result<(ChartData, Comparison<'_>)> {
    let Plan { system, scene, methods, .. } = plan;
    let implicit = plan.contact() || plan.implicit;
    let (finest, reference) = if implicit { (4 * most, "articulated, implicit") } else { (128, "articulated, RK4") };
    let exact = |n: usize| SolverSpec::articulated(if implicit { Stepping::Implicit } else { Stepping::Rk4 }, n);
    let bar = bar("solvers", methods.len() as u64 + 1);
    let converged = plan.beside(exact(finest).solver(system, 1)?)?;
    let base = converged.errors(&mut *exact(finest / 2).solver(system, 1)?)?;
    let [reference_error, hold] = [&base.error, &base.hold].map(|x| mean(x));
    bounds::figures(&format!("{reference}: its mean error"), &[reference_error, hold])?;
    let mut points = Vec::new();
    for (k, method) in methods.iter().enumerate() {
        bar.set(k as u64 + 1);
        bar.say(&method.spec.to_string());
        let theirs = method.own.map(|own| plan.beside(own.solver(system))).transpose()?;
        let theirs = theirs.as_ref().unwrap_or(&converged);
        for (series, found) in each(plan, method, theirs) {
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
fn each(plan: &Plan, Method { spec, series, .. }: &Method, theirs: &Comparison) -> Vec<(String, Result<Timed>)> {
    let compare = |solver: &mut dyn Solver| theirs.errors(solver);
    #[cfg(feature = "cuda")]
    if let Some(n) = plan.environments {
        let begun = plan.begun();
        let held = plan.protocol.held(&plan.system);
        let timed = |precision| card::timed(&begun, spec, precision, [n, plan.protocol.steps], held.as_ref(), &compare);
        let one = |(precision, word): &(_, &str)| (format!("{series}{word}"), timed(*precision));
        return card::arithmetics(spec).iter().map(one).collect();
    }
    let found = spec.solver(&plan.system, plan.protocol.starts).map_err(Error::from).and_then(|solver| {
        let (report, microseconds) = timed(solver, theirs.work(), compare)?;
        Ok(Timed { report, microseconds, memory: None })
    });
    vec![(series.clone(), found)]
}
