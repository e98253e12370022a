//! What surveys found, as tables.

use std::path::Path;

use anyhow::{Context, Result, bail};
use nerd_train::progress::bar;

use super::{CROWD, Course, Crowd, FRAMES, Found, Pace, PinocchioError, SETTINGS, Standing, Surveyed, crowd, differences, stand, survey};
use crate::report::Table;
use crate::report::table::digits;

/// Every 100th frame is in the table of courses.
const EVERY: usize = 100;

/// Each file read and rolled out, a line each; notes of a robot that is alone.
pub fn read(files: &[Found], pinocchio: Option<(&Path, usize)>) -> Result<(Vec<Table>, Vec<String>)> {
    let bar = bar("robots", files.len() as u64);
    // A panic has a line in the table; elsewhere it would tear the bar.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let mut robots = Vec::new();
    for (k, file) in files.iter().enumerate() {
        bar.set(k as u64);
        robots.push(survey(file));
    }
    std::panic::set_hook(hook);
    bar.finish();
    let header = ["file", "links", "joints", "mass (kg)", "meshes passed over", "fixed base", "floating base"];
    let sum = format!(
        "{} files: {} move on a fixed base, {} on a floating one. `ok`: {FRAMES} frames from zero coordinates under gravity, \
         `articulated`, preset `converged`, finite; else what is missing. Links and joints are those that move on a fixed base; \
         a joint has one DoF, a floating base six more.",
        files.len(),
        robots.iter().filter(|r| r.fixed.is_ok()).count(),
        robots.iter().filter(|r| r.floating.is_ok()).count()
    );
    let mut tables = vec![Table::new("urdfs", &header).with(robots.iter().map(row)).noted(&sum)];
    if let Some((python, states)) = pinocchio {
        tables.push(beside(python, states, files, &robots)?);
    }
    let notes = if let [robot] = &robots[..] { robot.notes.clone() } else { Vec::new() };
    Ok((tables, notes))
}

/// Largest relative differences from Pinocchio's dynamics, of both bases.
fn beside(python: &Path, states: usize, files: &[Found], robots: &[Surveyed]) -> Result<Table> {
    let bar = bar("robots", 2 * robots.len() as u64);
    let mut rows = Vec::new();
    let (mut version, mut same) = (String::new(), 0);
    for (k, (file, robot)) in files.iter().zip(robots).enumerate() {
        let path = std::fs::canonicalize(&file.path).with_context(|| format!("cannot read {}", file.path.display()))?;
        for (base, robot) in ["fixed", "floating"].into_iter().zip(&robot.robots) {
            bar.set(2 * k as u64);
            let Some(robot) = robot else { continue };
            let mut cells = vec![file.name.clone(), base.to_string()];
            match differences(python, &path, robot, states, 0) {
                Ok((worst, found)) => {
                    same += usize::from(worst.values().all(|x| *x < SAME));
                    version = found;
                    cells.extend(QUANTITIES.map(|q| worst.get(q).map_or("-".into(), |x| format!("{x:.0e}"))));
                }
                Err(PinocchioError::Robot(reason)) => {
                    cells.push(reason.replace('|', "/"));
                    cells.resize(2 + QUANTITIES.len(), String::new());
                }
                Err(absent) => bail!("--pinocchio: {absent}"),
            }
            rows.push(cells);
        }
    }
    bar.finish();
    let header: Vec<&str> = ["file", "base"].into_iter().chain(QUANTITIES).collect();
    let note = format!(
        "Dynamics beside Pinocchio {version} at {states} random states: largest entry of the difference over the largest of Pinocchio's \
         (or over 1e-6, where that is more), the worst state. {same} of {} rows are below {SAME:.0e} in everything.",
        rows.len()
    );
    Ok(Table::new("pinocchio", &header).with(rows).noted(&note))
}

/// What is compared, in words: the mass matrix, torques at rest, inverse and forward dynamics, their derivatives, Jacobians of frames.
const QUANTITIES: [&str; 9] = ["mass", "bias", "inverse", "forward", "inverse_q", "inverse_qd", "forward_q", "forward_qd", "jacobian"];
/// Closer than this, two dynamics are the same.
const SAME: f64 = 1e-9;

fn row(robot: &Surveyed) -> Vec<String> {
    let sizes = robot
        .sizes
        .map_or(["-"; 4].map(String::from), |s| [s.links.to_string(), s.joints.to_string(), digits(s.mass), s.meshes.to_string()]);
    let found = |moves: &Result<usize, String>| match moves {
        Ok(0) => "ok: nothing to move".into(),
        Ok(4) => "ok".into(),
        Ok(substeps) => format!("ok at {substeps} substeps"),
        Err(reason) => reason.clone(),
    };
    let floating = if robot.fixed.is_err() && robot.fixed == robot.floating { "the same".into() } else { found(&robot.floating) };
    [robot.name.clone()].into_iter().chain(sizes).chain([found(&robot.fixed), floating]).collect()
}

/// Each robot stands and falls; what cannot has a line.
pub fn standing(files: &[Found], mujoco: Option<&Path>) -> Result<Vec<Table>> {
    let bar = bar("robots", files.len() as u64);
    let (mut rows, mut courses) = (Vec::new(), Vec::new());
    for (k, file) in files.iter().enumerate() {
        bar.set(k as u64);
        match stand(file, mujoco) {
            Ok(standing) => {
                rows.push(stood(&file.name, &standing));
                courses.extend(course(&file.name, &standing));
            }
            Err(reason) => {
                rows.push([file.name.clone(), reason.to_string().replace('|', "/")].into_iter().chain(vec![String::new(); 10]).collect())
            }
        }
    }
    bar.finish();
    let header = [
        "file",
        "pose",
        "points",
        "kp (N m/rad)",
        "height at the start (m)",
        "after ten seconds (m)",
        "MuJoCo (m)",
        "tilt (deg)",
        "MuJoCo (deg)",
        "limp: lost (J)",
        "energy rose by (J)",
        "deepest point (mm)",
    ];
    let note = "Ten seconds on the plane `plane`, preset `accurate`, contact at points of the robot's own collision shapes. Each joint is held \
        by a drive inside the substep, `kp = m g L` with its mass and extent, `kd = kp / 20`, efforts as in its URDF; MuJoCo has the same \
        bodies, points and drives as MJCF, its own contacts (impratio 100, so that feet do not creep), IMPLICITFAST, 32 steps a frame. \
        Height of the root, tilt from the start. Limp: the same without drives; how much the energy, with what springs of contacts and \
        limits hold, rose at most over that of any earlier frame.";
    Ok(vec![
        Table::new("standing", &header).with(rows).noted(note),
        Table::new("courses", &["file", "seconds", "height (m)", "MuJoCo (m)", "tilt (deg)", "MuJoCo (deg)"])
            .with(courses)
            .noted("The same over time."),
    ])
}

fn stood(name: &str, standing: &Standing) -> Vec<String> {
    let end = |course: &Course, k: usize| [&course.height, &course.tilt][k].last().map_or("-".into(), |x| shown(*x, k));
    let beside = |k| standing.mujoco.as_ref().map_or("-".into(), |m| end(m, k));
    let Standing { pose, points, kp, start, ours, limp, .. } = standing;
    vec![
        name.into(),
        pose.clone(),
        points.to_string(),
        digits(*kp),
        shown(*start, 0),
        end(ours, 0),
        beside(0),
        end(ours, 1),
        beside(1),
        digits(limp.lost),
        digits(limp.rise),
        format!("{:.2}", 1e3 * limp.deepest),
    ]
}

fn course(name: &str, standing: &Standing) -> Vec<Vec<String>> {
    let at = |course: Option<&Course>, k: usize, f: usize| course.map_or("-".into(), |c| shown([&c.height, &c.tilt][k][f], k));
    let (ours, mujoco) = (Some(&standing.ours), standing.mujoco.as_ref());
    let row = |f: usize| {
        let seconds = format!("{:.1}", (f + 1) as f64 / 60.0);
        vec![name.into(), seconds, at(ours, 0, f), at(mujoco, 0, f), at(ours, 1, f), at(mujoco, 1, f)]
    };
    (EVERY - 1..standing.ours.height.len()).step_by(EVERY).map(row).collect()
}

/// A height (m), or an angle (rad) in degrees.
fn shown(x: f64, angle: usize) -> String {
    if angle == 1 { format!("{:.2}", x.to_degrees()) } else { format!("{x:.4}") }
}

/// Many of each robot that differ, beside MuJoCo; and why some cannot be measured.
pub fn crowds(files: &[Found], mujoco: &Path, n: usize) -> Result<(Vec<Table>, Vec<String>)> {
    let (mut tables, mut failed) = (Vec::new(), Vec::new());
    for file in files {
        let bar = bar("settings", SETTINGS as u64);
        let found = crowd(file, mujoco, n, 0, &mut |done| bar.set(done as u64));
        bar.finish();
        // One that cannot be measured ends no other's turn.
        match found {
            Ok(found) => tables.push(crowded(file, n, &found)),
            Err(reason) => failed.push(format!("{}: {reason}", file.name)),
        }
    }
    if tables.is_empty() {
        bail!(failed.join("; "));
    }
    Ok((tables, failed))
}

fn crowded(file: &Found, n: usize, found: &Crowd) -> Table {
    let row = |p: &Pace| {
        let beside = found.cheapest(p).map_or("-".into(), |(substeps, ratio)| format!("{} ({substeps} substeps)", digits(ratio)));
        let (joints, root, frames) = (digits(p.joints), digits(p.root), digits(p.frames));
        vec![p.engine.into(), p.substeps.to_string(), joints, root, frames, beside]
    };
    let note = format!(
        "{n} of the robot, masses of links times U(0.8, 1.2), frictions from U(0.3, 1.0), fall 2 cm onto a plane, joints up to 0.3 rad from \
         where drives hold them; {CROWD} frames of 1/60 s, one core, MuJoCo {} (IMPLICITFAST, its default contacts; elliptic cones and an impratio of 100, so that feet do not creep, or its default friction). Errors: mean \
         distance from the same engine at 256 substeps, of the first 256 robots. Last column: frames/s of ours over MuJoCo's, at ours' fewest \
         substeps that err by no more than that row in joints and in root. At 256 substeps the engines' joints are {} apart.",
        found.version,
        digits(found.apart)
    );
    let header = ["engine", "substeps", "joints (rad or m)", "root (m)", "frames/s", "ours over MuJoCo, errors no larger"];
    Table::new(&format!("crowd of {}", file.name), &header).with(found.paces.iter().map(row)).noted(&note)
}
