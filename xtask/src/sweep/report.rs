//! What a sweep says: means and spreads over seeds, as a table, numbers and, of sizes, error against time.

use anyhow::Result;

use super::entries::{BASE, Set};
use super::{AT, Measured, SweepArgs};
use nerd_train::report::Provenance;
use nerd_train::report::plot::{Figure, Series};
use nerd_train::report::table::{digits, markdown, pair};

/// Mean and standard deviation.
fn moments(x: &[f64]) -> [f64; 2] {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let spread = (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (x.len().max(2) - 1) as f64).sqrt();
    [mean, spread]
}

/// Writes `sweep-SET-ROBOT.json`, `.md` and, of sizes, pictures.
pub fn write(args: &SweepArgs, all: &[Measured]) -> Result<()> {
    let of = |name: &str| all.iter().filter(|m| m.name == name).cloned().collect::<Vec<_>>();
    let at = |runs: &[Measured], k: usize| moments(&runs.iter().map(|m| m.at[k]).collect::<Vec<_>>());
    let base = of(BASE);
    let mut names: Vec<&str> = Vec::new();
    all.iter().for_each(|m| {
        if !names.contains(&m.name) {
            names.push(m.name)
        }
    });
    let rows = names.iter().map(|name| {
        let runs = of(name);
        let mut row = vec![name.to_string(), runs[0].parameters.to_string()];
        row.extend((0..AT.len()).map(|k| {
            let ([mean, spread], [whole, _]) = (at(&runs, k), at(&base, k));
            // A run that left has no error to take the mean of.
            if mean.is_finite() && whole.is_finite() {
                format!("{} +- {} ({:.2})", digits(mean), digits(spread), mean / whole)
            } else {
                if mean.is_finite() { digits(mean) } else { "left".into() }
            }
        }));
        let quantities = runs[0].error.len();
        let error: Vec<f64> = (0..quantities).map(|q| moments(&runs.iter().map(|m| m.error[q]).collect::<Vec<_>>())[0]).collect();
        row.push(pair(&error));
        row.push(runs.iter().map(|m| m.diverged).sum::<usize>().to_string());
        row.push(digits(moments(&runs.iter().map(|m| m.microseconds).collect::<Vec<_>>())[0]));
        row
    });
    let header = AT.map(|frame| format!("{frame} frames (over base's)"));
    let table = markdown(
        &["run", "parameters", &header[0], &header[1], &header[2], "over the paper's horizon", "diverged", "us a frame, one core"],
        &rows.collect::<Vec<_>>(),
    );
    let stamp = Provenance::now(args.seed[0]);
    let mut whole = super::base(&args.robot, args, args.seed[0]);
    args.set.entries().iter().filter(|e| e.name == BASE).for_each(|e| (e.change)(&mut whole));
    let text = format!(
        "# Sweep of {:?}, {}\n\nEach run differs from `base` in one thing: a network of width {} and {} layers on flight, streaming, Muon, bent loss at \
         0.02, half of the data passive, {} updates of {} sequences of 32 tokens on {} transitions and {} fresh ones. Passive motion from {} starts: mean error \
         (rad or m) at a frame, mean and standard deviation over seeds {:?}, and divided by the base's.\n\n{table}\n`{}`, commit {}, {}, {}\n",
        args.set,
        args.robot,
        whole.embedding,
        whole.layers,
        args.updates,
        args.batch,
        args.transitions,
        args.fresh,
        args.starts,
        args.seed,
        stamp.command,
        stamp.commit,
        stamp.machine,
        stamp.date,
    );
    println!("{text}");
    let stem = args.out.join(format!("sweep-{:?}-{}", args.set, args.robot).to_lowercase());
    crate::files::write(&stem.with_extension("md"), text.as_bytes())?;
    let json = serde_json::json!({ "provenance": stamp, "rows": all });
    crate::files::write(&stem.with_extension("json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    if args.set != Set::Sizes {
        return Ok(());
    }
    // A size is one point: the quickest of its runs, since others may be on the machine, and the mean of their errors.
    let series = names.iter().map(|name| {
        let runs = of(name);
        let time = runs.iter().map(|m| m.microseconds).fold(f64::INFINITY, f64::min);
        let errors: Vec<f64> = runs.iter().map(|m| m.error.iter().sum::<f64>() / m.error.len() as f64).collect();
        Series { name: name.to_string(), points: vec![(time, moments(&errors)[0], name.to_string())] }
    });
    let figure = Figure {
        title: format!("{}: networks of several sizes", args.robot),
        x: "microseconds a frame, one environment, one core".into(),
        y: "mean error over the paper's horizon (rad or m)".into(),
        series: series.collect(),
        front: Vec::new(),
        levels: Vec::new(),
    };
    Ok(figure.save(&stem)?)
}
