//! The figures as people read them.

use nerd_sim::measured::{EDGE, Score};

use super::{Effect, Measured};
use crate::report::Table;
use crate::report::table::digits;

impl Measured {
    /// Methods, changes, and the fitted table.
    pub(super) fn tables(&self) -> Vec<Table> {
        vec![self.methods(), self.changes(), self.fitted()]
    }

    fn methods(&self) -> Table {
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
        Table::new("methods", &header).with(rows).noted(&format!(
            "{} real tosses of a cube, {} windows of 80 samples; error: mean |dp| (m) / mean angle (rad); whole tosses: % of the cube's \
             width / degrees, mean ± standard deviation over tosses. Nothing is fitted here.",
            self.tosses, self.windows
        ))
    }

    fn changes(&self) -> Table {
        let rows = self.lines.iter().map(|line| {
            let cells = line.by_method.iter().flat_map(|effect| {
                let error = effect.as_ref().map_or("-".into(), |e| window(&e.error));
                [error, effect.as_ref().and_then(|e| e.parted.as_ref()).map_or("-".into(), window)]
            });
            std::iter::once(line.change.clone()).chain(cells).collect()
        });
        let header = ["change", "rapier 4 x 1", "it parts by", "articulated implicit x16", "this parts by"];
        Table::new("changes", &header).with(rows).noted(&format!(
            "What the errors come from: one change at a time, windows with lifted starts. Error against the measurement, and distance from \
             the prediction of the first line.\n\n{}",
            self.words()
        ))
    }

    /// What follows from the figures and does not stand in the table.
    fn words(&self) -> String {
        let find = |start: &str| self.lines.iter().find(|l| l.change.starts_with(start)).and_then(|l| l.by_method[1].as_ref());
        let Some(Effect { error: base, .. }) = find("nothing") else { return String::new() };
        let (n, floor) = (&self.noise, &self.floor);
        format!(
            "In words, for `articulated implicit x16`. **Noise**: in {} flights, where the velocity must be linear and the spin constant, \
             measured velocities scatter by {:.1} mm/s and {:.3} rad/s an axis. Put on the starts once more, that parts two predictions of \
             one solver by {}, and {:.1} % of them end on different faces. No solver can be asked for less; the error is {:.1} and {:.1} \
             times as much. **The tail**: half of the windows stay below {:.4} m and {:.3} rad; {:.1} % end on another face than the real \
             cube, and they hold {:.0} % of all the angles. **Starts in the table**: the measured cube rests about 1 mm deep in it (the \
             length scale and noise), and a spring throws it out. What is left after noise and the difference of two solvers is what both \
             have in common, most likely a perfect cube with one friction and one restitution everywhere.",
            n.flights,
            1e3 * n.velocity,
            n.spin,
            window(floor),
            100.0 * floor.other_face,
            base.position / floor.position,
            base.rotation / floor.rotation,
            base.position_median,
            base.rotation_median,
            100.0 * base.other_face,
            100.0 * base.other_face_angles,
        )
    }

    fn fitted(&self) -> Table {
        let (fit, before) = (&self.fit.fit, &self.fit.odd_before);
        let row = |name: &str, even: Option<&Score>, odd: &Score| vec![name.into(), even.map_or("-".into(), window), window(odd)];
        let header = ["setting", "even tosses (chosen on)", "odd tosses (scored on)"];
        let rows = [
            row("rapier 4 x 1, published, starts as measured", None, &before[0]),
            row("rapier 4 x 1, published, lifted", None, &before[1]),
            row("articulated implicit x16, as above, lifted", None, &before[2]),
            row("articulated implicit x16, FITTED, lifted", Some(&fit.even), &fit.odd),
        ];
        Table::new("fitted", &header).with(rows).noted(&format!(
            "The best of {} settings of the compliant table: stiffness {} N/m, damping {} N s/m (restitution {}), friction damping {} \
             N s/m; friction stays 0.18.",
            fit.tried,
            digits(fit.cube.stiffness),
            digits(fit.damping),
            fit.cube.restitution,
            digits(fit.cube.friction_damping)
        ))
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
