//! Our own solvers, timed and compared with the reference.

use nerd_sim::instruments::{Recorder, Replay};

use super::plan::{Method, Plan};
use super::shown::{ChartData, Point};
use crate::prelude::*;
use nerd_train::cost::timed;

type Frames = Vec<Vec<f64>>;

/// Every method's point, and the frames of the reference.
pub(super) fn all(plan: &Plan, most: usize) -> Result<(ChartData, Frames)> {
    let Plan { system, scene, methods, protocol, .. } = plan;
    let implicit = plan.contact() || system.held();
    let (finest, reference) = if implicit { (4 * most, "articulated, implicit") } else { (128, "articulated, RK4") };
    let exact = |n: usize| if implicit { Setting::Implicit(n) } else { Setting::Rk4(n) };
    let solvers = methods.iter().map(|m| Ok(m.setting.solver(system)?)).collect::<Result<Vec<_>>>()?;
    let bar = progress::bar("solvers", solvers.len() as u64 + 1);
    let mut truth = Recorder::new(exact(finest).solver(system)?);
    let base = passive(system, scene, &mut truth, &mut *exact(finest / 2).solver(system)?, *protocol, &mut |_| ())?;
    let truth = truth.frames;
    let [reference_error, hold] = [&base.error, &base.hold].map(|x| mean(x));
    bounds::figures(&format!("{reference}: its mean error"), &[reference_error, hold])?;
    let mut points = Vec::new();
    for (k, (method, solver)) in methods.iter().zip(solvers).enumerate() {
        bar.set(k as u64 + 1);
        bar.say(&method.setting.to_string());
        let theirs = method.own.map(|own| recorded(plan, own.solver(system), &truth)).transpose()?;
        let theirs = theirs.as_ref().unwrap_or(&truth);
        let compare = |solver: &mut dyn Solver| passive(system, scene, &mut Replay::new(theirs), solver, *protocol, &mut |_| ());
        let point = timed(solver, protocol.starts * protocol.steps, compare).map_err(Error::from);
        let point = point.and_then(|(report, microseconds)| {
            let Method { series, setting, own } = method;
            let point = Point::new(series.clone(), Some(setting.clone()), setting.substeps(), microseconds, report, own.is_some());
            bounds::figures("its mean error", &[point.error])?;
            Ok(point)
        });
        match point {
            Ok(point) => points.push(point),
            Err(error) => bar.line(&format!("{}: left out, {error}", method.setting)),
        }
    }
    bar.finish();
    let data = ChartData {
        robot: system.name.clone(),
        scene: scene.name.clone(),
        protocol: *protocol,
        reference: format!("{reference}, {finest} substeps"),
        reference_error,
        hold,
        points,
        mujoco: None,
    };
    Ok((data, truth))
}

fn recorded(plan: &Plan, truth: Box<dyn Solver>, idle: &[Vec<f64>]) -> Result<Frames> {
    let mut truth = Recorder::new(truth);
    passive(&plan.system, &plan.scene, &mut truth, &mut Replay::new(idle), plan.protocol, &mut |_| ())?;
    Ok(truth.frames)
}
