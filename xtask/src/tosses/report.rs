//! The figures as text, JSON and a picture.

use std::path::Path;

use anyhow::Result;

use super::cube::EDGE;
use super::{Curve, Effect, Fit, Line, Noise, Row, Score, figure};
use crate::provenance::Provenance;
use crate::table::{digits, markdown};

/// All that was measured.
#[derive(serde::Serialize)]
pub struct Report {
    pub tosses: usize,
    pub windows: usize,
    pub rows: Vec<Row>,
    pub lines: Vec<Line>,
    pub noise: Noise,
    /// Prediction with noise on its start against that without.
    pub floor: Score,
    pub fit: Fit,
}

/// Rows of the picture.
const DRAWN: [&str; 6] = [
    "articulated implicit x16",
    "articulated implicit x1",
    "rapier 4 x 1",
    "articulated paper, its own cube",
    "no motion",
    "flight, frozen at the first touch",
];

impl Report {
    /// For the terminal and tosses.md.
    pub fn text(&self) -> String {
        format!(
            "# Real cube tosses\n\n{} tosses, {} windows of 80 samples; error: mean |dp| (m) / mean angle (rad); whole tosses: % of the \
             cube's width / degrees, mean ± standard deviation over tosses. Nothing is fitted here.\n\n{}\n\
             ## What the errors come from\n\nOne change at a time, windows with lifted starts. Left: error against the measurement; right: distance \
             from the prediction of the first line.\n\n{}\n{}\n## Fitted\n\n{}",
            self.tosses,
            self.windows,
            self.methods(),
            self.changes(),
            self.words(),
            self.fitted()
        )
    }

    fn methods(&self) -> String {
        let rows = self.rows.iter().map(|r| {
            let some = |s: &Option<Score>, text: fn(&Score) -> String| s.as_ref().map_or("-".into(), text);
            vec![
                r.method.clone(),
                some(&r.raw, window),
                window(&r.lifted),
                some(&r.metric, window),
                share(&r.whole),
                some(&r.whole_metric, share),
                r.microseconds.map_or("-".into(), digits),
                r.lost.to_string(),
            ]
        });
        let header = ["method", "as measured", "lifted", "lifted, metric", "whole toss", "whole toss, metric", "us a frame", "lost"];
        markdown(&header, &rows.collect::<Vec<_>>())
    }

    fn changes(&self) -> String {
        let rows = self.lines.iter().map(|line| {
            let cells = line.by_method.iter().flat_map(|effect| {
                let error = effect.as_ref().map_or("-".into(), |e| window(&e.error));
                [error, effect.as_ref().and_then(|e| e.parted.as_ref()).map_or("-".into(), window)]
            });
            std::iter::once(line.change.clone()).chain(cells).collect()
        });
        markdown(&["change", "rapier 4 x 1", "parts by", "articulated implicit x16", "parts by"], &rows.collect::<Vec<_>>())
    }

    /// What follows from the figures.
    fn words(&self) -> String {
        let find = |start: &str| self.lines.iter().find(|l| l.change.starts_with(start)).and_then(|l| l.by_method[1].as_ref());
        let error = |start: &str| find(start).map_or("-".into(), |e| window(&e.error));
        let parted = |start: &str| find(start).and_then(|e| e.parted.as_ref()).map_or("-".into(), window);
        let Some(Effect { error: base, .. }) = find("nothing") else { return String::new() };
        let n = &self.noise;
        format!(
            "In words, for `articulated implicit x16` ({}). **Noise**: in {} flights, where the velocity must be linear and the spin \
             constant, measured velocities scatter by {:.1} mm/s and {:.3} rad/s an axis. Put on the starts once more, that parts two \
             predictions of one solver by {}, and {:.1} % of them end on different faces. No solver can be asked for less; the error is \
             {:.1} and {:.1} times as much. A thousandth of the noise parts them by {}. **The tail**: half of the windows stay \
             below {:.4} m and {:.3} rad; {:.1} % end on another face than the real cube, and they hold {:.0} % of all the angles. \
             **Restitution** from 0.06 to 0.25 moves the prediction by up to {}, the error to {} and {}; 0.5 is plainly wrong ({}). \
             **Friction**: 0.01 more or less moves it by {}; at 0.15 and 0.21 the error is {} and {}. **The cone**: a law that lets \
             small slips go by (Huber) has {}, a quarter of the friction damping {}; two round cones, rapier's and ours, part by {} \
             with all else that is different between them. **Length**: metric {}, half a frame's age of the velocities {}. \
             **Stiffness**, ten times: {}. **Starts in the table**: the measured cube rests about 1 mm deep in it (the length scale and \
             noise), and a spring throws it out: {} as measured. What is left after noise and the difference of two solvers is what \
             both have in common, most likely a perfect cube with one friction and one restitution everywhere.\n",
            window(base),
            n.flights,
            1e3 * n.velocity,
            n.spin,
            parted("noise"),
            100.0 * self.floor.other_face,
            base.position / self.floor.position,
            base.rotation / self.floor.rotation,
            parted("a thousandth"),
            base.position_median,
            base.rotation_median,
            100.0 * base.other_face,
            100.0 * base.other_face_angles,
            parted("restitution 0.25"),
            error("restitution 0.06"),
            error("restitution 0.25"),
            error("restitution 0.5"),
            parted("friction 0.17"),
            error("friction 0.15"),
            error("friction 0.21"),
            error("another friction law"),
            error("a fourth of the friction damping"),
            parted("the other solver"),
            error("lengths metric"),
            error("velocities in flight"),
            error("ten times the stiffness"),
            error("starts as measured"),
        )
    }

    fn fitted(&self) -> String {
        let fit = &self.fit;
        let row = |name: &str, even: Option<&Score>, odd: &Score| vec![name.into(), even.map_or("-".into(), window), window(odd)];
        let table = markdown(
            &["setting", "even tosses (chosen on)", "odd tosses (scored on)"],
            &[
                row("rapier 4 x 1, published, starts as measured", None, &fit.odd_before[0]),
                row("rapier 4 x 1, published, lifted", None, &fit.odd_before[1]),
                row("articulated implicit x16, as above, lifted", None, &fit.odd_before[2]),
                row("articulated implicit x16, FITTED, lifted", Some(&fit.even), &fit.odd),
            ],
        );
        format!(
            "The best of {} settings of the compliant table: stiffness {} N/m, damping {} N s/m (restitution {}), friction damping {} N s/m; \
             friction stays 0.18.\n\n{table}",
            fit.tried,
            digits(fit.cube.stiffness),
            digits(fit.damping),
            fit.cube.restitution,
            digits(fit.cube.friction_damping)
        )
    }

    /// Writes tosses.json, .md, .svg and .png.
    pub fn write(&self, text: &str, out: &Path, stamp: Provenance) -> Result<()> {
        let json = serde_json::json!({ "provenance": stamp, "measured": self });
        crate::files::write(&out.join("tosses.json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
        let from = format!("\n`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
        crate::files::write(&out.join("tosses.md"), (text.to_string() + &from).as_bytes())?;
        let row = |name: &&str| self.rows.iter().find(|r| r.method == **name);
        let curve = |r: &'_ Row| (r.method.clone(), r.lifted.clone(), r.microseconds.is_none());
        let mut curves: Vec<_> = DRAWN.iter().filter_map(row).map(curve).collect();
        curves.push(("what noise on velocities does".into(), self.floor.clone(), true));
        let curves: Vec<Curve> = curves.iter().map(|(name, score, dashed)| Curve { name: name.clone(), score, dashed: *dashed }).collect();
        Ok(figure::draw(&curves, &out.join("tosses"))?)
    }
}

/// Metres and radians of windows.
fn window(score: &Score) -> String {
    format!("{:.4} / {:.3}", score.position, score.rotation)
}

/// Share of the width and degrees of whole tosses.
fn share(score: &Score) -> String {
    let [p, ps] = [score.position, score.position_spread].map(|x| 100.0 * x / EDGE);
    let [r, rs] = [score.rotation, score.rotation_spread].map(f64::to_degrees);
    format!("{p:.1} ± {ps:.1} / {r:.1} ± {rs:.1}")
}
