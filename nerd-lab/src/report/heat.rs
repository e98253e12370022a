//! A stability map at a glance: green up to the limit, through amber to red, white figures.

use std::path::Path;

use nerd_sim::suite::Line;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::plot::{Picture, failed, save};
use super::table::digits;
use crate::error::Result;

const LEFT: i32 = 200;
const TOP: i32 = 70;
const CELL: (i32, i32) = (104, 24);

/// Writes `STEM.svg` and `STEM.png`.
///
/// # Errors
/// If it cannot be drawn or written.
pub fn draw(title: &str, columns: &[String], lines: &[Line], stem: &Path) -> Result<()> {
    let size = ((LEFT + (CELL.0 * columns.len() as i32 + 20).max(740)) as u32, (TOP + CELL.1 * lines.len() as i32 + 40) as u32);
    save(stem, size, &Heat { title, columns, lines })
}

struct Heat<'a> {
    title: &'a str,
    columns: &'a [String],
    lines: &'a [Line],
}

impl Picture for Heat<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = failed::<B>;
        let style = |size: i32, colour: RGBColor, h: HPos| ("sans-serif", size).into_font().color(&colour).pos(Pos::new(h, VPos::Center));
        let text = |words: &str, at: (i32, i32), style: TextStyle| area.draw(&Text::new(words.to_string(), at, style)).map_err(failed);
        area.fill(&WHITE).map_err(failed)?;
        text(self.title, (LEFT, 20), style(17, BLACK, HPos::Left))?;
        for (k, name) in self.columns.iter().enumerate() {
            // What follows a comma stands below, or names would run into each other.
            let parts: Vec<&str> = name.splitn(2, ", ").collect();
            for (row, part) in parts.iter().rev().enumerate() {
                let at = (LEFT + CELL.0 * k as i32 + CELL.0 / 2, TOP - 12 - 16 * row as i32);
                text(part, at, style(13, BLACK, HPos::Center))?;
            }
        }
        for (r, line) in self.lines.iter().enumerate() {
            let y = TOP + CELL.1 * r as i32;
            text(&line.row, (LEFT - 10, y + CELL.1 / 2), style(13, BLACK, HPos::Right))?;
            for (k, cell) in line.cells.iter().enumerate() {
                let x = LEFT + CELL.0 * k as i32;
                let box_ = [(x + 1, y + 1), (x + CELL.0 - 1, y + CELL.1 - 1)];
                let Some(figure) = cell.figure else { continue };
                let ratio = if line.limit > 0.0 { figure / line.limit } else { 1e9 * figure };
                let ratio = if cell.lost.is_some() { f64::MAX } else { ratio };
                area.draw(&Rectangle::new(box_, colour(ratio).filled())).map_err(failed)?;
                let words = if cell.lost.is_some() { "lost".to_string() } else { digits(figure) };
                text(&words, (x + CELL.0 / 2, y + CELL.1 / 2), style(12, WHITE, HPos::Center))?;
            }
        }
        let y = TOP + CELL.1 * self.lines.len() as i32 + 20;
        let legend =
            [("a tenth of the limit", 0.05), ("the limit", 0.5), ("10 times", 5.0), ("1000 times", 50.0), ("more, or lost", f64::MAX)];
        text("figure up to", (LEFT - 10, y), style(13, BLACK, HPos::Right))?;
        for (k, (words, ratio)) in legend.into_iter().enumerate() {
            let x = LEFT + 146 * k as i32;
            area.draw(&Rectangle::new([(x, y - 8), (x + 24, y + 8)], colour(ratio).filled())).map_err(failed)?;
            text(words, (x + 32, y), style(13, BLACK, HPos::Left))?;
        }
        area.present().map_err(failed)
    }
}

/// Colours the colour-blind tell apart by lightness too.
fn colour(ratio: f64) -> RGBColor {
    match ratio {
        x if x <= 0.1 => RGBColor(0, 110, 80),
        x if x <= 1.0 => RGBColor(0, 158, 115),
        x if x <= 10.0 => RGBColor(222, 143, 5),
        x if x <= 1000.0 => RGBColor(213, 94, 0),
        _ => RGBColor(128, 20, 40),
    }
}
