//! Why bars differ from the paper's, said with the figures of this very run.

use super::NERD;
use super::measure::steps;
use super::report::{Errors, Row, here, one_frame};
use crate::table::digits;

/// The section.
pub fn text(rows: &[Row], robots: &[String]) -> String {
    let paragraphs = robots.iter().flat_map(|robot| {
        let mine: Vec<&Row> = rows.iter().filter(|r| r.robot == *robot).collect();
        [scale, inputs, architectures, window].map(|say| say(robot, &mine, rows))
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
    Some(format!(
        "**{robot}: the scale is short.** A predictor that only repeats the start has {} times NeRD's error over {} frames, so bars much\n\
         above that do not fit, however wrong the variant. Of one frame, before errors have grown, E2E has {end} times NeRD's error,\n\
         Abs Pred {absolute}, No Inp. Norm {raw}, GRU {gru}, MLP {mlp}.\n",
        digits(rows.first()?.ceiling(all)?),
        steps(robot),
    ))
}

/// Inputs as they are.
fn inputs(robot: &str, rows: &[&Row], _all: &[Row]) -> Option<String> {
    let [nerd, raw] = named(rows, [NERD, "No Inp. Norm"])?;
    let [least, most] = nerd.measured.first()?.scales;
    Some(format!(
        "**{robot}: inputs.** Their standard deviations run from {} to {} (torques). Without normalisation the torques drown the rest until a\n\
         long training has undone it: validation loss {} against NeRD's {}, still falling by a factor of {} from the third quarter of the run\n\
         to the last. So No Inp. Norm stands higher among the bars than after the paper's millions of updates.\n",
        digits(least),
        digits(most),
        digits(raw.loss()),
        digits(nerd.loss()),
        digits(raw.falling()),
    ))
}

/// How fast each architecture learns.
fn architectures(robot: &str, rows: &[&Row], _all: &[Row]) -> Option<String> {
    let all = named(rows, [NERD, "MLP", "LSTM", "GRU"])?;
    let [nerd, mlp, lstm, gru] = all.map(|r| digits(r.loss()));
    let falling = all.map(|r| digits(r.falling()));
    Some(format!(
        "**{robot}: architectures.** Validation losses at the end: NeRD {nerd}, MLP {mlp}, LSTM {lstm}, GRU {gru}. From the third quarter of\n\
         the run to the last the training losses still fell by factors of {}, {}, {} and {}: none of the runs has come to its end, and the\n\
         order among rivals is that of learning speed at this length. The paper's is that after millions of updates.\n",
        falling[0], falling[1], falling[2], falling[3],
    ))
}

/// What history gives, apart from more tokens in an update.
fn window(robot: &str, rows: &[&Row], all: &[Row]) -> Option<String> {
    let [one, ten] = named(rows, ["h = 1", "h = 1, 10x"])?;
    Some(format!(
        "**{robot}: the window.** An update of NeRD holds ten times the tokens of one of h = 1. Given as many (`h = 1, 10x`), h = 1 has {} times\n\
         NeRD's error in place of {}, and of one frame {} in place of {}: only what is above 1 of that is history's. The data has no\n\
         noise and the truth no memory, so history can help a network that is not exact, and no other.\n",
        share(ten, all, here),
        share(one, all, here),
        share(ten, all, one_frame),
        share(one, all, one_frame),
    ))
}
