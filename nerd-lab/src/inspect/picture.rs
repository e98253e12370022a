//! A histogram of every column, on one sheet.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::columns::{BINS, Block, Column};
use crate::error::Result;
use crate::report::plot::{COLOURS, Picture, failed, save};
use crate::report::table::digits;

const CELL: (i32, i32) = (150, 92);
const TOP: i32 = 62;
const MARGIN: i32 = 16;

pub(super) fn draw(title: &str, columns: &[Column], tokens: u64, stem: &Path) -> Result<()> {
    let sheet = Sheet { title, columns, tokens, across: across(columns.len()) };
    let down = columns.len().div_ceil(sheet.across);
    let width = (2 * MARGIN + CELL.0 * sheet.across as i32).max(1130);
    save(stem, (width as u32, (TOP + CELL.1 * down as i32 + 12) as u32), &sheet)
}

/// Cells in a row: a sheet that is wider than high, but no wider than a screen can show.
fn across(n: usize) -> usize {
    ((1.2 * n as f64).sqrt().ceil() as usize).clamp(7, 17)
}

struct Sheet<'a> {
    title: &'a str,
    columns: &'a [Column],
    tokens: u64,
    across: usize,
}

impl Picture for Sheet<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = failed::<B>;
        let style = |size: i32, h: HPos| ("sans-serif", size).into_font().color(&BLACK.mix(0.85)).pos(Pos::new(h, VPos::Center));
        let text =
            |words: &str, at: (i32, i32), size: i32, h: HPos| area.draw(&Text::new(words.to_string(), at, style(size, h))).map_err(failed);
        area.fill(&WHITE).map_err(failed)?;
        text(self.title, (MARGIN, 18), 17, HPos::Left)?;
        let mut x = MARGIN;
        for (block, colour) in Block::ALL.iter().zip(&COLOURS).filter(|(b, _)| self.columns.iter().any(|c| c.block == **b)) {
            area.draw(&Rectangle::new([(x, 38), (x + 14, 50)], colour.filled())).map_err(failed)?;
            text(block.name(), (x + 20, 44), 12, HPos::Left)?;
            x += 34 + 8 * block.name().len() as i32;
        }
        for (k, column) in self.columns.iter().enumerate() {
            let (x, y) = (MARGIN + CELL.0 * (k % self.across) as i32, TOP + CELL.1 * (k / self.across) as i32);
            let colour = COLOURS[Block::ALL.iter().position(|b| *b == column.block).unwrap_or(0)];
            let (left, right, top, floor) = (x + 2, x + CELL.0 - 12, y + 18, y + 70);
            text(&column.name, (left, y + 9), 11, HPos::Left)?;
            let absent = column.contact.map(|_| format!("{:.1} % seen", 100.0 * column.count as f64 / self.tokens.max(1) as f64));
            let note = if column.count > 0 && column.constant() { Some("constant".to_string()) } else { absent };
            if let Some(note) = note {
                text(&note, (right, y + 9), 10, HPos::Right)?;
            }
            area.draw(&PathElement::new([(left, floor), (right, floor)], BLACK.mix(0.4).stroke_width(1))).map_err(failed)?;
            // Roots, so that a peak of what rests leaves something to see of what moves.
            let most = column.bars.iter().copied().max().unwrap_or(0);
            if most == 0 {
                continue;
            }
            let at = |i: usize| left + (right - left) * i as i32 / BINS as i32;
            let up = |n: u64| floor - ((floor - top) as f64 * (n as f64 / most as f64).sqrt()).round() as i32;
            let steps = column.bars.iter().enumerate().flat_map(|(i, n)| [(at(i), up(*n)), (at(i + 1), up(*n))]);
            let outline: Vec<(i32, i32)> = [(left, floor)].into_iter().chain(steps).chain([(right, floor)]).collect();
            area.draw(&Polygon::new(outline, colour.mix(0.8).filled())).map_err(failed)?;
            text(&digits(column.low), (left, floor + 9), 9, HPos::Left)?;
            text(&digits(column.high), (right, floor + 9), 9, HPos::Right)?;
        }
        area.present().map_err(failed)
    }
}
