//! Tasks by name or file.

use std::path::Path;

use nerd_sim::files::read_text;

use crate::{FileTask, LeadTip, Task, TaskError};

/// Files of the tasks that have a robot of their own: first the paper's tasks, in the order of the paper's table.
const OWN: [(&str, &str); 9] = [
    ("cartpole-swingup", include_str!("../assets/cartpole-swingup.toml")),
    ("franka-reach", include_str!("../assets/franka-reach.toml")),
    ("franka-reach-torque", include_str!("../assets/franka-reach-torque.toml")),
    ("ant-run", include_str!("../assets/ant-run.toml")),
    ("ant-spin", include_str!("../assets/ant-spin.toml")),
    ("ant-spin-track", include_str!("../assets/ant-spin-track.toml")),
    ("anymal-forward", include_str!("../assets/anymal-forward.toml")),
    ("anymal-side", include_str!("../assets/anymal-side.toml")),
    ("ant-point", include_str!("../assets/ant-point.toml")),
];

/// Files of tasks for any robot.
const GENERAL: [(&str, &str); 4] = [
    ("walk", include_str!("../assets/walk.toml")),
    ("rough", include_str!("../assets/rough.toml")),
    ("stand", include_str!("../assets/stand.toml")),
    ("reach", include_str!("../assets/reach.toml")),
];

/// Names of all built-in tasks that have a robot of their own.
pub fn names() -> Vec<&'static str> {
    let mut all: Vec<_> = OWN.iter().map(|(name, _)| *name).collect();
    all.insert(8, LeadTip.name());
    all
}

/// Names of tasks for any robot; `walk@go2.urdf` applies one to a robot.
pub fn general() -> Vec<&'static str> {
    GENERAL.iter().map(|(name, _)| *name).collect()
}

/// A task's name as part of a folder name: `walk-go2` for `walk@robots/go2.urdf`.
pub fn word(name: &str) -> String {
    let stem =
        |part: &str| Path::new(part).file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let (task, robot) = parts(name);
    [task].into_iter().chain(robot).map(stem).collect::<Vec<_>>().join("-")
}

/// Splits a name such as `walk@go2.urdf` into the name or path of the task and that of the robot. Either path may
/// contain another `@`.
pub fn parts(name: &str) -> (&str, Option<&str>) {
    let known = |task: &str| task.ends_with(".toml") || general().contains(&task) || names().contains(&task);
    let mut all = name.match_indices('@').map(|(at, _)| (&name[..at], Some(&name[at + 1..])));
    let first = name.split_once('@').filter(|_| !known(name)).map(|(task, robot)| (task, Some(robot)));
    all.find(|(task, _)| known(task)).or(first).unwrap_or((name, None))
}

/// A task by name, or by the path of its file (.toml). `TASK@ROBOT` applies the task to a robot; a built-in task for
/// another robot is refused. The given name becomes the task's name.
///
/// # Errors
/// If there is no such task, or its file or its robot is invalid.
pub fn named(name: &str) -> Result<Box<dyn Task>, TaskError> {
    let (task, robot) = parts(name);
    if let Some((_, text)) = GENERAL.iter().find(|(own, _)| *own == task) {
        return Ok(Box::new(FileTask::new(name, text, robot)?));
    }
    let own: Option<Box<dyn Task>> = match OWN.iter().find(|(own, _)| *own == task) {
        Some((_, text)) => Some(Box::new(FileTask::new(name, text, None)?)),
        None => (task == LeadTip.name()).then(|| Box::new(LeadTip) as Box<dyn Task>),
    };
    if let Some(own) = own {
        return match robot.filter(|robot| *robot != own.robot()) {
            Some(_) => Err(TaskError::Other(task.into(), own.robot(), general().join(", "))),
            None => Ok(own),
        };
    }
    // A cable's file also ends in .toml: `wlk@lead.toml` may be a misspelt task with a cable, or the file of a task.
    let unknown = match task.split_once('@') {
        Some((own, _)) if !Path::new(task).exists() => Some(format!("{own}` and no file `{task}")),
        _ => Path::new(task).extension().is_none_or(|ending| ending != "toml").then(|| task.into()),
    };
    if let Some(unknown) = unknown {
        return Err(TaskError::Unknown(unknown, [names(), general()].concat().join(", ")));
    }
    let text = read_text(Path::new(task)).map_err(|e| TaskError::File(task.into(), e.to_string()))?;
    Ok(Box::new(FileTask::new(name, &text, robot)?))
}
