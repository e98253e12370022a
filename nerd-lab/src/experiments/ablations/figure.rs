//! Bars on a log axis: a panel for each robot, ours beside the paper's.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::bars::NERD;
use super::rows::{Errors, GAP, ONE_FRAME, ROLLED, Row, robots};
use crate::error::Result;
use crate::report::plot::{COLOURS, Picture, failed, save};

const SIZE: (u32, u32) = (1400, 900);
/// Room between columns, in bars' places.
const ROOM: f64 = 0.7;
/// Pixels for the legend at the foot.
const FOOT: i32 = 34;

/// What a column of the figure is about.
const COLUMNS: [(char, &str); 4] = [('a', "(a) architecture"), ('b', "(b) other decisions"), ('c', "(c) window"), ('d', "control")];

/// Writes `stem`.svg and `stem`.png.
pub fn draw(rows: &[Row], stem: &Path) -> Result<()> {
    save(stem, (SIZE.0, SIZE.1 / 2 * robots(rows).len() as u32), &Bars(rows))
}

struct Bars<'a>(&'a [Row]);

/// One bar: height, whisker, colour.
type Bar = (f64, Option<[f64; 2]>, RGBColor);
type Area<B> = DrawingArea<B, Shift>;
type Done<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;
/// Where on the whole picture a place and a height are.
type Pixel<'a> = dyn Fn(f64, f64) -> (i32, i32) + 'a;

impl Picture for Bars<'_> {
    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Result<()> {
        let failed = failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let (body, foot) = area.split_vertically(area.dim_in_pixel().1 as i32 - FOOT);
        let robots = robots(self.0);
        for (panel, robot) in body.split_evenly((robots.len(), 1)).iter().zip(robots) {
            self.panel(area, panel, robot).map_err(failed)?;
        }
        legend(&foot).map_err(failed)?;
        area.present().map_err(failed)
    }
}

impl Bars<'_> {
    /// Bars over one name.
    fn of(&self, row: &Row) -> Vec<Bar> {
        let ours = |of: Errors, colour| {
            let [mean, least, most] = row.ratio(self.0, of)?;
            Some((mean, (row.measured.len() > 1).then_some([least, most]), colour))
        };
        let bars = [ours(GAP, COLOURS[2]), ours(ROLLED, COLOURS[0]), ours(ONE_FRAME, COLOURS[5]), row.paper.map(|p| (p, None, COLOURS[1]))];
        bars.into_iter().flatten().collect()
    }

    /// One robot's.
    fn panel<B: DrawingBackend>(&self, area: &Area<B>, panel: &Area<B>, robot: &str) -> Done<B> {
        let rows: Vec<&Row> = self.0.iter().filter(|r| r.robot == robot).collect();
        let ceiling = rows.first().and_then(|r| r.ceiling(self.0));
        let heights = rows.iter().flat_map(|r| self.of(r)).map(|b| b.0).chain(ceiling);
        let (low, high) = heights.fold((1.0f64, 1.0f64), |(a, b), h| (a.min(h), b.max(h)));
        let (low, high) = (low / 2.0, high * 3.0);
        // Places along the axis: one for each bar's name, room before each column.
        let mut end = 0.0;
        let place = |(k, row): (usize, &&Row)| {
            end += if k > 0 && rows[k - 1].group != row.group { 1.0 + ROOM } else { 1.0 };
            end - 0.5
        };
        let places: Vec<f64> = rows.iter().enumerate().map(place).collect();
        let title = if robot == "ant" { "Ant, rewards of running policies" } else { "Double pendulum, contact-free passive motion" };
        let mut chart = ChartBuilder::on(panel)
            .caption(title, ("sans-serif", 19))
            .margin(10)
            .x_label_area_size(34)
            .y_label_area_size(62)
            .build_cartesian_2d(-0.2..end + 0.2, (low..high).log_scale())?;
        let mut mesh = chart.configure_mesh();
        mesh.disable_x_mesh().disable_x_axis().y_desc("error / NeRD's").label_style(("sans-serif", 14));
        mesh.light_line_style(BLACK.mix(0.05)).bold_line_style(BLACK.mix(0.15)).y_label_formatter(&|v| format!("{v}")).draw()?;
        chart.draw_series([PathElement::new([(-0.2, 1.0), (end + 0.2, 1.0)], BLACK.mix(0.6))])?;
        if let Some(level) = ceiling {
            chart.draw_series(DashedLineSeries::new([(-0.2, level), (end + 0.2, level)], 6, 5, BLACK.mix(0.5).into()))?;
        }
        let pixel = |x: f64, y: f64| chart.plotting_area().map_coordinate(&(x, y));
        for (place, row) in places.iter().zip(&rows) {
            bars(area, &self.of(row), *place, low, &pixel)?;
            let (x, y) = pixel(*place, low);
            let name = if row.name == NERD { format!("{} (NeRD)", row.name) } else { row.name.clone() };
            centred(area, name, (x, y + 7), 14, VPos::Top)?;
        }
        for (group, words) in COLUMNS {
            let Some(first) = rows.iter().position(|r| r.group == group) else { continue };
            let (x, y) = pixel(places[first] - 0.45, high);
            let style = ("sans-serif", 15).into_font().color(&BLACK.mix(0.6));
            area.draw(&Text::new(words, (x, y + 4), style))?;
        }
        Ok(())
    }
}

/// The bars over one place, with their heights above them.
fn bars<B: DrawingBackend>(area: &Area<B>, bars: &[Bar], place: f64, low: f64, pixel: &Pixel) -> Done<B> {
    let width = 0.92 / bars.len().max(3) as f64;
    let left = place - width * bars.len() as f64 / 2.0;
    for (k, (value, whisker, colour)) in bars.iter().enumerate() {
        let (a, b) = (left + k as f64 * width, left + (k + 1) as f64 * width);
        let (corner, foot) = (pixel(a, *value), pixel(b, low));
        area.draw(&Rectangle::new([corner, (foot.0 - 1, foot.1)], colour.mix(0.85).filled()))?;
        let (middle, mut top) = ((a + b) / 2.0, *value);
        if let Some([least, most]) = whisker {
            area.draw(&PathElement::new([pixel(middle, *least), pixel(middle, *most)], BLACK.stroke_width(1)))?;
            top = top.max(*most);
        }
        let (x, y) = pixel(middle, top);
        let short = if *value < 9.95 { format!("{value:.1}") } else { format!("{value:.0}") };
        centred(area, short, (x, y - 3), 12, VPos::Bottom)?;
    }
    Ok(())
}

fn centred<B: DrawingBackend>(area: &Area<B>, text: String, at: (i32, i32), size: i32, side: VPos) -> Done<B> {
    let style = TextStyle::from(("sans-serif", size).into_font()).pos(Pos::new(HPos::Center, side));
    area.draw(&Text::new(text, at, style))
}

/// At the foot.
fn legend<B: DrawingBackend>(foot: &Area<B>) -> Done<B> {
    let names = [(2, "ours, rewards"), (0, "ours, passive motion"), (5, "ours, one frame"), (1, "paper, Figure A.2")]
        .map(|(k, name)| (COLOURS[k], name));
    for (k, (colour, words)) in names.iter().enumerate() {
        let (x, y) = (70 + 260 * k as i32, 6);
        foot.draw(&Rectangle::new([(x, y), (x + 16, y + 14)], colour.mix(0.85).filled()))?;
        foot.draw(&Text::new(*words, (x + 24, y), ("sans-serif", 14)))?;
    }
    let (x, y) = (70 + 260 * names.len() as i32, 13);
    for dash in 0..3 {
        foot.draw(&PathElement::new([(x + 11 * dash, y), (x + 11 * dash + 6, y)], BLACK.mix(0.5)))?;
    }
    foot.draw(&Text::new("ours, repeating the start", (x + 38, y - 7), ("sans-serif", 14)))
}
