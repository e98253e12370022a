//! What the ablations say, as tables.

use super::rows::{Errors, FALLING, GAP, HOLD, LOSS, MARGIN, ONE_FRAME, ROLLED, Row, pairs, robots};
use super::{Ablated, BATCH, NERD, frames};
use crate::report::Table;
use crate::report::table::{digits, pair};

/// Variants whose targets are not NeRD's.
const OTHER_TARGETS: [&str; 4] = ["E2E", "Abs Pred", "World Frame", "No Out. Norm"];

/// By robot the bars and the pairs in another order than the paper's; of all robots how many those are, and what bars differ by.
pub fn all(data: &Ablated) -> Vec<Table> {
    let mut tables = Vec::new();
    for robot in robots(&data.rows) {
        let rows = of(data, robot);
        tables.extend([bars(data, robot, &rows), margins(data, robot, &rows)]);
    }
    tables.extend([order(data), reasons(data)]);
    tables
}

fn of<'a>(data: &'a Ablated, robot: &str) -> Vec<&'a Row> {
    data.rows.iter().filter(|r| r.robot == robot).collect()
}

/// The errors of the paper's test case: of running policies where there are any.
fn tested(rows: &[&Row]) -> (Errors, &'static str) {
    let running = rows.iter().all(|r| r.mean(GAP).is_some());
    if running { (GAP, "gap") } else { (ROLLED, "rollouts") }
}

fn shown(row: &Row, of: Errors) -> String {
    row.mean(of).map_or_else(|| "-".into(), |e| pair(&e))
}

/// Divided by NeRD's; of several seeds with the least and the largest.
fn ratio(row: &Row, all: &[Row], of: Errors) -> String {
    match row.ratio(all, of) {
        Some([mean, least, most]) if row.measured.len() > 1 => format!("{} ({} to {})", digits(mean), digits(least), digits(most)),
        Some([mean, ..]) => digits(mean),
        None => "-".into(),
    }
}

fn percent(row: &Row) -> String {
    row.mean(GAP).map_or_else(|| "-".into(), |gap| format!("{:.1} %", 100.0 * gap[0]))
}

/// Every variant of a robot.
fn bars(data: &Ablated, robot: &str, rows: &[&Row]) -> Table {
    let (running, settings) = (tested(rows).1 == "gap", &data.settings);
    let mut header = vec!["variant", "parameters", "windows x tokens", "minutes", "error", "validation loss", "one frame", "diverged"];
    header.extend(["error / NeRD's", "one frame / NeRD's"]);
    header.extend(running.then_some(["gap", "gap / NeRD's"]).into_iter().flatten());
    header.push("paper");
    let cells = rows.iter().map(|r| {
        let mut cells = vec![r.name.clone(), r.parameters.to_string(), format!("{} x {}", r.batch, r.history), r.minutes.join(" / ")];
        cells.extend([ROLLED, LOSS, ONE_FRAME].map(|of| shown(r, of)));
        cells.push(r.measured.iter().map(|m| m.diverged).sum::<usize>().to_string());
        cells.extend([ROLLED, ONE_FRAME].map(|of| ratio(r, &data.rows, of)));
        if running {
            cells.extend([percent(r), ratio(r, &data.rows, GAP)]);
        }
        cells.push(r.paper.map_or_else(|| "-".into(), |p| p.to_string()));
        cells
    });
    let (frames, hold) = (frames(robot), rows.first().map_or_else(String::new, |r| shown(r, HOLD)));
    let case = if running {
        format!(
            "The paper's test case: running policies, {} games of each; the gap is |reward in the variant - in the truth| over the latter, mean over \
             policies. Error: passive motion on the ground for {frames} frames, position (m) / orientation / joints (rad).",
            settings.games
        )
    } else {
        format!("Error: contact-free passive motion for {frames} frames, joints (rad).")
    };
    let note = format!(
        "{robot}: NeRD with one decision taken back. Same data, {} updates of {BATCH} windows, networks of equal parameter counts, Muon for hidden \
         matrices and Adam for the rest; seeds {:?}. {case} {} starts; NeRD is `{NERD}`. A predictor that repeats the start: {hold}.",
        settings.updates, settings.seed, settings.starts
    );
    Table::new(robot, &header).with(cells).noted(&note)
}

/// Pairs of bars that stand in the other order than the paper's by the test case or by one frame.
fn margins(data: &Ablated, robot: &str, rows: &[&Row]) -> Table {
    let (errors, name) = tested(rows);
    let first = pairs(rows, &data.rows, ONE_FRAME);
    let lines = pairs(rows, &data.rows, errors).into_iter().filter_map(|p| {
        let one = first.iter().find(|q| (&q.larger.name, &q.smaller.name) == (&p.larger.name, &p.smaller.name)).map(|q| q.ours);
        let wrong = p.ours <= 1.0 || one.is_some_and(|ours| ours <= 1.0);
        let pair = format!("{} over {}", p.larger.name, p.smaller.name);
        wrong.then(|| vec![pair, digits(p.paper), digits(p.ours), one.map_or_else(|| "-".into(), digits)])
    });
    let note = format!("{robot}: pairs that stand in the other order than the paper's by either, with their margins.");
    Table::new(&format!("{robot}-margins"), &["pair", "paper", name, "one frame"]).with(lines).noted(&note)
}

/// How many pairs stand in the paper's order.
fn order(data: &Ablated) -> Table {
    let lines = robots(&data.rows).into_iter().map(|robot| {
        let rows = of(data, robot);
        let same: Vec<&Row> = rows.iter().filter(|r| !OTHER_TARGETS.contains(&r.name.as_str())).copied().collect();
        let kept = |rows: &[&Row], errors| {
            let pairs = pairs(rows, &data.rows, errors);
            format!("{} of {}", pairs.iter().filter(|p| p.ours > 1.0).count(), pairs.len())
        };
        vec![robot.to_string(), kept(&rows, tested(&rows).0), kept(&rows, ONE_FRAME), kept(&same, LOSS)]
    });
    let header = ["robot", "by the test case", "by one frame", "same targets, by validation loss"];
    let note = format!("Pairs of bars that the paper sets apart by more than {MARGIN}x and that stand in the same order here.");
    Table::new("order", &header).with(lines).noted(&note)
}

const REASONS: &str = "A bar of rollouts can hardly rise above that of a predictor that repeats the start, however wrong the variant; one frame, before \
    errors have grown, says more. Random torques never reach a runner's states, and a network this small does not know them after so few updates: an Ant \
    that lies where it fell has a gap of about 100 %, where bars of the gap end but for a variant that takes off. Without input normalisation the torques \
    drown the rest until training has undone it, which a short run shows more of than a long one. Training losses still fell: the order among \
    architectures is that of learning speed, and runs of this length neither confirm nor refute the paper's after five million updates. An update of `h = 1` \
    has a tenth of NeRD's tokens, one of `h = 1, 10x` as many: what NeRD is ahead of that is history's, the rest is tokens'.";

/// Why bars differ from the paper's.
fn reasons(data: &Ablated) -> Table {
    let robots = robots(&data.rows);
    let line = |what: &str, figure: &dyn Fn(&[&Row]) -> Option<String>| {
        let figures = robots.iter().map(|robot| figure(&of(data, robot)).unwrap_or_else(|| "-".into()));
        [what.to_string()].into_iter().chain(figures).collect::<Vec<_>>()
    };
    let named = |rows: &[&Row], name: &str| rows.iter().find(|r| r.name == name).map(|r| Row::clone(r));
    let fell = |name: &'static str| {
        line(&format!("training loss of the third quarter over that of the last, {name}"), &|rows| {
            Some(shown(&named(rows, name)?, FALLING))
        })
    };
    let lines = vec![
        line("error of a predictor that repeats the start / NeRD's", &|rows| Some(digits(rows.first()?.ceiling(&data.rows)?))),
        line("gap of NeRD", &|rows| named(rows, NERD).map(|r| percent(&r))),
        line("standard deviations of the inputs, least and largest (torques)", &|rows| {
            Some(named(rows, NERD)?.measured.first()?.scales.map(digits).join(" to "))
        }),
        fell(NERD),
        fell("LSTM"),
        fell("GRU"),
    ];
    let header: Vec<&str> = ["figure"].into_iter().chain(robots.iter().copied()).collect();
    Table::new("reasons", &header).with(lines).noted(REASONS)
}
