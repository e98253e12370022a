//! A task as a program for a graphics card: what surrounds a solver in an episode. Its text is plain C++, too, so that a test runs it
//! where there is no card.

use std::fmt::Write;

use nerd_sim::articulated::device::episode;
use nerd_sim::system::System;

use super::Formulas;
use super::text::written;

/// The text for a task, for scenes of at most so many colliders: the kernels `task_act` and `task_judge`.
///
/// # Errors
/// What of the robot's starts has no kernel; a formula that speaks of what there is not.
pub(super) fn program(task: &impl Formulas, system: &System, colliders: usize) -> Result<String, String> {
    let (about, mut text) = (Formulas::about(task), episode(system, colliders)?);
    let sizes =
        [("SEEN", about.observation), ("ACTIONS", about.action), ("GOALS", task.goal().len()), ("STEP_FRAMES", about.frames as usize)];
    for (name, n) in sizes {
        let _ = writeln!(text, "#define {name} {n}");
    }
    let _ = writeln!(text, "#define LENGTH {}ull", about.steps * about.frames);
    // None may be empty.
    let ends: Vec<String> = task.goal().iter().flatten().chain(&[0.0]).map(|x| format!("{x:e}")).collect();
    let _ = writeln!(text, "TABLE double ASKED[] = {{{}}};", ends.join(", "));
    text.push_str(include_str!("sight.cuh"));
    text.push_str(&written(task, system)?);
    text.push_str(include_str!("task.cuh"));
    Ok(text)
}
