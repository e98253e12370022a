//! Why bars differ from the paper's, said with the figures of this very run.

use super::NERD;
use super::measure::steps;
use super::report::{Errors, Row, gap, here, one_frame};
use nerd_train::report::table::digits;

/// The section.
pub fn text(rows: &[Row], robots: &[String]) -> String {
    let paragraphs = robots.iter().flat_map(|robot| {
        let mine: Vec<&Row> = rows.iter().filter(|r| r.robot == *robot).collect();
        [scale, runners, axes, inputs, architectures, window].map(|say| say(robot, &mine, rows))
    });
    let paragraphs: Vec<String> = paragraphs.flatten().collect();
    if paragraphs.is_empty() { String::new() } else { format!("\n## What differs, and why\n\n{}", paragraphs.join("\n")) }
}

/// The rows of these names, if all are there.
fn named<'a, const N: usize>(rows: &[&'a Row], names: [&str; N]) -> Option<[&'a Row; N]> {
    let found: Vec<&Row> = names.iter().filter_map(|name| rows.iter().find(|r| r.name == *name).copied()).collect();
    found.try_into().ok()
}

/// Error divided by NeRD's.
fn share(row: &Row, all: &[Row], of: Errors) -> String {
    row.ratio(all, of).map_or_else(|| "-".into(), |[mean, ..]| digits(mean))
}

/// Errors that have grown as large as they can hide how wrong a variant is.
fn scale(robot: &str, rows: &[&Row], all: &[Row]) -> Option<String> {
    let [end, absolute, raw, gru, mlp] = named(rows, ["E2E", "Abs Pred", "No Inp. Norm", "GRU", "MLP"])?;
    let [end, absolute, raw, gru, mlp] = [end, absolute, raw, gru, mlp].map(|r| share(r, all, one_frame));
    let ceiling = rows.first()?.ceiling(all)?;
    let verdict = if ceiling < 1.5 {
        "so NeRD itself knows hardly more than nothing there, and the bars of rollouts say little"
    } else {
        "so bars much above that do not fit, however wrong the variant"
    };
    Some(format!(
        "**{robot}: the scale is short.** A predictor that only repeats the start has {} times NeRD's error over {} frames,\n\
         {verdict}. Of one frame, before errors have grown, E2E has\n\
         {end} times NeRD's error, Abs Pred {absolute}, No Inp. Norm {raw}, GRU {gru}, MLP {mlp}. The paper's NeRD had five million updates.\n",
        digits(ceiling),
        steps(robot),
    ))
}

/// Policies that run where NeRD itself cannot follow.
fn runners(robot: &str, rows: &[&Row], _all: &[Row]) -> Option<String> {
    let [nerd] = named(rows, [NERD])?;
    let gap = nerd.measured.iter().map(|m| m.gap).sum::<Option<f64>>()? / nerd.measured.len() as f64;
    (gap > 0.5).then(|| {
        format!(
            "**{robot}: the runners.** NeRD's own gap is {:.0} % (the paper's: 4). Random torques never reach a runner's states, and a network this small\n\
             after this few updates does not know them; an Ant that lies where it fell has a gap of about 100 %, so bars of the gap end there,\n\
             but for a variant that takes off.\n",
            100.0 * gap
        )
    })
}

/// World axes, where a robot can leave the place of its data.
fn axes(robot: &str, rows: &[&Row], all: &[Row]) -> Option<String> {
    let [nerd, world, end] = named(rows, [NERD, "World Frame", "E2E"])?;
    let percent = |row: &Row| row.measured.iter().map(|m| m.gap).sum::<Option<f64>>().map(|g| 100.0 * g / row.measured.len() as f64);
    Some(format!(
        "**{robot}: world axes.** Runners leave the box of the data. Of one frame within it World Frame errs {} times as much as NeRD, E2E {}; their\n\
         gaps are {:.1} and {:.1} % against NeRD's {:.1} %, {} and {} times as large.\n",
        share(world, all, one_frame),
        share(end, all, one_frame),
        percent(world)?,
        percent(end)?,
        percent(nerd)?,
        share(world, all, gap),
        share(end, all, gap),
    ))
}

/// Inputs as they are.
fn inputs(robot: &str, rows: &[&Row], _all: &[Row]) -> Option<String> {
    let [nerd, raw] = named(rows, [NERD, "No Inp. Norm"])?;
    let [least, most] = nerd.measured.first()?.scales;
    Some(format!(
        "**{robot}: inputs.** Their standard deviations run from {} to {} (torques), so without normalisation the torques drown the rest until\n\
         training has undone it: validation loss {} against NeRD's {} after these updates. A short run shows more of that than a long one.\n",
        digits(least),
        digits(most),
        digits(raw.loss()),
        digits(nerd.loss()),
    ))
}

/// How fast each architecture learns.
fn architectures(robot: &str, rows: &[&Row], _all: &[Row]) -> Option<String> {
    let all = named(rows, [NERD, "MLP", "h = 1", "LSTM", "GRU"])?;
    let [nerd, mlp, one, lstm, gru] = all.map(|r| digits(r.loss()));
    let [fell, _, _, slow, slower] = all.map(|r| digits(r.falling()));
    Some(format!(
        "**{robot}: architectures.** Validation losses: NeRD {nerd}; MLP {mlp} and h = 1 {one}, both of single tokens; LSTM {lstm}, GRU {gru}, although\n\
         an update of theirs holds ten times the MLP's tokens: recurrent networks learn slowest. Training losses still fell from the third\n\
         quarter of the run to the last, by factors of {fell} (NeRD), {slow} (LSTM) and {slower} (GRU). The order among rivals is that of learning\n\
         speed; runs of this length can neither confirm nor refute the paper's after millions of updates.\n",
    ))
}

/// What history gives, apart from more tokens in an update.
fn window(robot: &str, rows: &[&Row], all: &[Row]) -> Option<String> {
    let [nerd, one, ten] = named(rows, [NERD, "h = 1", "h = 1, 10x"])?;
    Some(format!(
        "**{robot}: the window.** An update of NeRD holds ten times the tokens of one of h = 1. Given as many (`h = 1, 10x`), h = 1 comes to a\n\
         validation loss of {} in place of {} (NeRD {}), and to {} times NeRD's error in rollouts in place of {}. What NeRD still has ahead of\n\
         that is history's, the rest is tokens'. The data has no noise and the truth no memory, so history has little to add.\n",
        digits(ten.loss()),
        digits(one.loss()),
        digits(nerd.loss()),
        share(ten, all, here),
        share(one, all, here),
    ))
}
