//! `cargo xtask list robots|scenes|tasks|models`: lists names that command lines may use.

use nerd_tasks::{general, named, names};

use crate::{describe::title, out, prelude::*};

#[derive(clap::Subcommand)]
pub enum What {
    /// List the built-in robots; the path of a .urdf, MJCF (.xml) or cable .toml names any other
    Robots,
    /// List the scenes of each robot
    Scenes {
        /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable
        /// .toml [default: all built-in robots]
        #[arg(long)]
        robot: Option<String>,
    },
    /// List the tasks of policies
    Tasks,
    /// List the shipped models
    Models,
}

pub fn run(what: What) -> Result<()> {
    out::table(&match what {
        What::Robots => robots()?,
        What::Scenes { robot } => scenes(robot.as_deref())?,
        What::Tasks => tasks()?,
        What::Models => models()?,
    });
    Ok(())
}

fn robots() -> Result<Table> {
    let mut table =
        Table::new("robots", ["robot", "base", "joints", "state", "contact points", "frame (ms)", "data from"]);
    for name in known() {
        let system = System::named(name)?;
        let (robot, spec) = (&system.robot, &system.spec);
        let base = if robot.floating() { "free" } else { "fixed" };
        let random = if spec.random_plane.is_some() { "random planes" } else { "free" };
        let numbers = [robot.joint_count(), robot.state_dim(), robot.contact_points.len()].map(|n| n.to_string());
        let frame = format!("{:.2}", 1000.0 * system.frame_time);
        let data = spec.data_scene.as_deref().unwrap_or(random);
        table.rows.push([&[name.into(), base.into()], &numbers[..], &[frame, data.into()]].concat());
    }
    Ok(table)
}

fn known<'a>() -> Vec<&'a str> {
    [System::built_in(), System::families(), System::cables()].concat()
}

fn scenes(robot: Option<&str>) -> Result<Table> {
    let mut table = Table::new("scenes", ["robot", "scene", "ground", "friction"]);
    for name in robot.map_or_else(known, |robot| vec![robot]) {
        let system = System::named(name)?;
        for scene in system.all_scenes() {
            let (ground, friction) = ground(&system.scene(scene)?);
            table.rows.push(vec![system.name.clone(), scene.into(), ground, friction]);
        }
    }
    Ok(table)
}

/// Describes the colliders of a scene; also returns the friction coefficient of the first.
fn ground(scene: &Arc<Scene>) -> (String, String) {
    let Some(first) = scene.colliders.first() else { return ("empty space".into(), String::new()) };
    let words = match (&first.plane, scene.colliders.len()) {
        (Some(plane), 1) => {
            let slope = (-plane.normal.dot(&scene.gravity) / scene.gravity.norm()).clamp(-1.0, 1.0).acos().to_degrees();
            format!("plane, {slope:.0} degrees, at {:.2} m", plane.offset)
        }
        (_, 1) => "one shape".into(),
        (_, n) => format!("{n} shapes"),
    };
    (words, first.material.friction.to_string())
}

fn tasks() -> Result<Table> {
    let mut table = Table::new("tasks", ["task", "robot", "scene", "observation", "action", "steps", "frames a step"]);
    for name in names() {
        let task = named(name)?;
        let numbers = [task.observation_dim() as u64, task.action_dim() as u64, task.episode_length(), task.frames()]
            .map(|n| n.to_string());
        table.rows.push([&[name, task.robot(), task.scene()].map(String::from), &numbers[..]].concat());
    }
    // Leaves out the sizes of tasks for any robot, which depend on the robot.
    let row = |name| [name, "any (--robot)", "-", "-", "-", "-", "-"].map(String::from).into();
    table.rows.extend(general().into_iter().map(row));
    Ok(table)
}

fn models() -> Result<Table> {
    let mut table = Table::new("models", ["model", "robot", "truth", "network", "transitions", "updates"]);
    for folder in shipped::folders(&shipped::models(), "")? {
        let Ok(model) = ModelConfig::read(&folder) else { continue };
        let network = title(&SolverSpec::neural(&folder))?;
        let [transitions, updates] = [model.transitions as u64, model.updates].map(|n| n.to_string());
        table.rows.push(vec![shipped::from_root(&folder), model.robot, model.truth, network, transitions, updates]);
    }
    Ok(table)
}
