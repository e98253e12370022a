//! Bars on a log axis: a row for each robot, ours beside the paper's.

use std::path::Path;

use nerd_train::Result;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::NERD;
use super::report::{Errors, Row, gap, here, one_frame};
use nerd_train::report::plot::{COLOURS, Picture, save};

const SIZE: (u32, u32) = (1400, 900);
/// Gap between columns, in bars' places.
const GAP: f64 = 0.7;
/// Pixels for the legend at the foot.
const FOOT: i32 = 34;

/// What a column of the figure is about.
const COLUMNS: [(char, &str); 4] = [('a', "(a) architecture"), ('b', "(b) other decisions"), ('c', "(c) window"), ('d', "control")];

/// Writes `stem`.svg and `stem`.png.
pub fn draw(rows: &[Row], robots: &[String], stem: &Path) -> Result<()> {
    save(stem, (SIZE.0, SIZE.1 / 2 * robots.len() as u32), &Bars { rows, robots })
}

struct Bars<'a> {
    rows: &'a [Row],
    robots: &'a [String],
}

/// One bar: height, whisker, colour.
type Bar = (f64, Option<[f64; 2]>, RGBColor);

impl Bars<'_> {
    /// Bars over one name.
    fn of(&self, row: &Row) -> Vec<Bar> {
        let ours = |of: Errors, colour| {
            let [mean, least, most] = row.ratio(self.rows, of)?;
            Some((mean, (row.measured.len() > 1).then_some([least, most]), colour))
        };
        let bars = [ours(gap, COLOURS[2]), ours(here, COLOURS[0]), ours(one_frame, COLOURS[5]), row.paper.map(|p| (p, None, COLOURS[1]))];
        bars.into_iter().flatten().collect()
    }
}

impl Picture for Bars<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> nerd_train::Result<()> {
        let failed = nerd_train::report::plot::failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let height = area.dim_in_pixel().1 as i32;
        let (body, _) = area.split_vertically(height - FOOT);
        for (panel, robot) in body.split_evenly((self.robots.len(), 1)).iter().zip(self.robots) {
            let rows: Vec<&Row> = self.rows.iter().filter(|r| r.robot == *robot).collect();
            let ceiling = rows.first().and_then(|r| r.ceiling(self.rows));
            let heights = rows.iter().flat_map(|r| self.of(r)).map(|b| b.0).chain(ceiling);
            let (low, high) = heights.fold((1.0f64, 1.0f64), |(a, b), h| (a.min(h), b.max(h)));
            let (low, high) = (low / 2.0, high * 3.0);
            // Places along the axis: one for each bar's name, a gap before each column.
            let mut places = Vec::new();
            let mut x = 0.0;
            for (k, row) in rows.iter().enumerate() {
                x += if k > 0 && rows[k - 1].group != row.group { 1.0 + GAP } else { 1.0 };
                places.push(x - 0.5);
            }
            let title = match robot.as_str() {
                "pendulum" => "Double pendulum, contact-free passive motion".to_string(),
                _ => "Ant, rewards of running policies".to_string(),
            };
            let mut chart = ChartBuilder::on(panel)
                .caption(title, ("sans-serif", 19))
                .margin(10)
                .x_label_area_size(34)
                .y_label_area_size(62)
                .build_cartesian_2d(-0.2..x + 0.2, (low..high).log_scale())
                .map_err(failed)?;
            chart
                .configure_mesh()
                .disable_x_mesh()
                .disable_x_axis()
                .y_desc("error / NeRD's")
                .label_style(("sans-serif", 14))
                .light_line_style(BLACK.mix(0.05))
                .bold_line_style(BLACK.mix(0.15))
                .y_label_formatter(&|v| format!("{v}"))
                .draw()
                .map_err(failed)?;
            chart.draw_series([PathElement::new([(-0.2, 1.0), (x + 0.2, 1.0)], BLACK.mix(0.6))]).map_err(failed)?;
            if let Some(level) = ceiling {
                let line = DashedLineSeries::new([(-0.2, level), (x + 0.2, level)], 6, 5, BLACK.mix(0.5).into());
                chart.draw_series(line).map_err(failed)?;
            }
            let pixel = |x: f64, y: f64| chart.plotting_area().map_coordinate(&(x, y));
            let centred = |size: i32, v: VPos| TextStyle::from(("sans-serif", size).into_font()).pos(Pos::new(HPos::Center, v));
            for (place, row) in places.iter().zip(&rows) {
                let bars = self.of(row);
                let width = 0.92 / bars.len().max(3) as f64;
                let left = place - width * bars.len() as f64 / 2.0;
                for (k, (value, whisker, colour)) in bars.iter().enumerate() {
                    let (a, b) = (left + k as f64 * width, left + (k + 1) as f64 * width);
                    let (corner, foot) = (pixel(a, *value), pixel(b, low));
                    area.draw(&Rectangle::new([corner, (foot.0 - 1, foot.1)], colour.mix(0.85).filled())).map_err(failed)?;
                    let middle = (a + b) / 2.0;
                    let mut top = *value;
                    if let Some([least, most]) = whisker {
                        area.draw(&PathElement::new([pixel(middle, *least), pixel(middle, *most)], BLACK.stroke_width(1)))
                            .map_err(failed)?;
                        top = top.max(*most);
                    }
                    let (x, y) = pixel(middle, top);
                    area.draw(&Text::new(short(*value), (x, y - 3), centred(12, VPos::Bottom))).map_err(failed)?;
                }
                let (x, y) = pixel(*place, low);
                let name = if row.name == NERD { format!("{} (NeRD)", row.name) } else { row.name.clone() };
                area.draw(&Text::new(name, (x, y + 7), centred(14, VPos::Top))).map_err(failed)?;
            }
            for (group, words) in COLUMNS {
                let first = rows.iter().position(|r| r.group == group).map(|k| places[k] - 0.45);
                let Some(first) = first else { continue };
                let (x, y) = pixel(first, high);
                let style = ("sans-serif", 15).into_font().color(&BLACK.mix(0.6));
                area.draw(&Text::new(words, (x, y + 4), style)).map_err(failed)?;
            }
        }
        let legend = [
            (COLOURS[2], "ours, rewards"),
            (COLOURS[0], "ours, passive motion"),
            (COLOURS[5], "ours, one frame"),
            (COLOURS[1], "paper, Figure A.2"),
        ];
        for (k, (colour, words)) in legend.iter().enumerate() {
            let (x, y) = (70 + 260 * k as i32, height - FOOT + 6);
            area.draw(&Rectangle::new([(x, y), (x + 16, y + 14)], colour.mix(0.85).filled())).map_err(failed)?;
            area.draw(&Text::new(*words, (x + 24, y), ("sans-serif", 14))).map_err(failed)?;
        }
        let (x, y) = (70 + 260 * legend.len() as i32, height - FOOT + 13);
        for dash in 0..3 {
            area.draw(&PathElement::new([(x + 11 * dash, y), (x + 11 * dash + 6, y)], BLACK.mix(0.5))).map_err(failed)?;
        }
        area.draw(&Text::new("ours, repeating the start", (x + 38, y - 7), ("sans-serif", 14))).map_err(failed)?;
        area.present().map_err(failed)
    }
}

/// Two digits.
fn short(v: f64) -> String {
    if v < 9.95 { format!("{v:.1}") } else { format!("{v:.0}") }
}
