//! `cargo xtask urdf FILE ... --stand`: robots on their own feet, see [`nerd_lab::survey::stand`].

use std::path::Path;

use anyhow::Result;
use nerd_lab::report::table::digits;
use nerd_lab::report::{Artifact, Input, Inputs, Provenance, Table};
use nerd_lab::survey::{Course, Found, STANDING, Standing, stand};

use nerd_train::progress::bar;

/// Every 100th frame stands in the table of courses.
const EVERY: usize = 100;

/// Lets each robot stand and fall; what cannot has a line.
pub fn run(files: &[Found], mujoco: Option<&Path>, out: Option<&Path>) -> Result<()> {
    let bar = bar("robots", files.len() as u64);
    let (mut rows, mut courses) = (Vec::new(), Vec::new());
    for (k, file) in files.iter().enumerate() {
        bar.set(k as u64);
        match stand(file, mujoco) {
            Ok(standing) => {
                rows.push(row(&file.name, &standing));
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
    let tables = vec![
        Table::new("standing", &header).with(rows).noted(note),
        Table::new("courses", &["file", "seconds", "height (m)", "MuJoCo (m)", "tilt (deg)", "MuJoCo (deg)"])
            .with(courses)
            .noted("The same over time."),
    ];
    crate::out::tables(&tables);
    let Some(out) = out else { return Ok(()) };
    let (provenance, effort) = (Provenance::now(0), (files.len() * STANDING) as f64);
    let inputs = Inputs(vec![Input::files("URDFs", &files.iter().map(|found| found.path.clone()).collect::<Vec<_>>())?]);
    Ok(Artifact { provenance, inputs, effort, tables, data: Default::default() }.write(out, "standing")?)
}

fn row(name: &str, standing: &Standing) -> Vec<String> {
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
