//! Several replays as one moving picture: each in a cell of its own, the truth beside NeRD. And one as a still picture of a few moments.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use super::plot::{Picture, failed, save};
use super::replay::Replay;
use super::scene;
use crate::error::{Error, Result};

/// Size of a tile (px), of which a cell has two, and of the line above it.
const TILE: (u32, u32) = (130, 120);
const LINE: u32 = 22;
/// Cells in a row.
const COLUMNS: usize = 4;
/// Pictures a second.
const RATE: f64 = 15.0;
/// Of a still picture, two in a row: the size of one (px), and when they are, as shares of the motion.
const MOMENT: (u32, u32) = (480, 300);
const MOMENTS: [f64; 4] = [0.05, 0.2, 0.5, 1.0];

/// Writes replays as a GIF of so many seconds.
///
/// # Errors
/// If it cannot be drawn or written.
pub fn gif(replays: &[Replay], seconds: f64, path: &Path) -> Result<()> {
    register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular()).map_err(|_| Error::msg("the built-in font cannot be read"))?;
    let rows = replays.len().div_ceil(COLUMNS);
    let (cell, high) = (2 * TILE.0, TILE.1 + LINE);
    let size = (cell * COLUMNS as u32, high * rows as u32);
    let folder = tempfile::tempdir().map_err(crate::error::file(Path::new("a temporary folder")))?;
    let draft = folder.path().join("film.gif");
    let backend = BitMapBackend::gif(&draft, size, (1000.0 / RATE) as u32).map_err(|e| Error::msg(format!("cannot draw: {e}")))?;
    let area = backend.into_drawing_area();
    for picture in 0..(seconds * RATE) as usize {
        area.fill(&WHITE).map_err(failed::<BitMapBackend>)?;
        for (replay, cell) in replays.iter().zip(area.split_evenly((rows, COLUMNS))) {
            let (line, tiles) = cell.split_vertically(LINE);
            let (left, right) = tiles.split_horizontally(TILE.0);
            let frame = (picture as f64 / RATE / replay.dt) as usize;
            // The truth stands on the left.
            let style = ("sans-serif", 13).into_font().color(&BLACK.mix(0.75));
            line.draw(&Text::new(format!("{}: truth, NeRD", replay.title), (8, 5), style)).map_err(failed::<BitMapBackend>)?;
            for (track, tile) in [(1, left), (0, right)] {
                if track < replay.tracks.len() {
                    scene::draw(replay, &[track], frame, &tile)?;
                }
            }
        }
        area.present().map_err(failed::<BitMapBackend>)?;
    }
    drop(area);
    super::write(path, &std::fs::read(&draft).map_err(crate::error::file(&draft))?)
}

/// Writes `stem`.svg and `stem`.png: a replay at four moments, its first motion solid, the others as ghosts, and below where it comes from.
///
/// # Errors
/// If it cannot be drawn or written.
pub fn still(replay: &Replay, origin: &str, stem: &Path) -> Result<()> {
    save(stem, (2 * MOMENT.0, 2 * MOMENT.1 + 2 * LINE), &Still { replay, origin })
}

struct Still<'a> {
    replay: &'a Replay,
    origin: &'a str,
}

impl Picture for Still<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let (replay, failed) = (self.replay, failed::<B>);
        let line = |area: &DrawingArea<B, Shift>, text: &str, size: u32| {
            let style = ("sans-serif", size).into_font().color(&BLACK.mix(0.75));
            area.draw(&Text::new(text.to_string(), (8, 5), style)).map_err(failed)
        };
        area.fill(&WHITE).map_err(failed)?;
        let (head, rest) = area.split_vertically(LINE);
        let (tiles, foot) = rest.split_vertically(2 * MOMENT.1);
        let names: Vec<String> = replay.tracks.iter().map(|track| track.name.clone()).collect();
        line(&head, &format!("{}: {}", replay.title, names.join(", as a ghost ")), 14)?;
        line(&foot, self.origin, 10)?;
        let tracks: Vec<usize> = (0..replay.tracks.len()).collect();
        for (tile, share) in tiles.split_evenly((2, 2)).iter().zip(MOMENTS) {
            let frame = (share * replay.frames().saturating_sub(1) as f64).round() as usize;
            scene::draw(replay, &tracks, frame, tile)?;
            let apart = replay.apart.get(frame).map_or_else(String::new, |x| format!(", {:.0} mm apart", 1e3 * x));
            line(tile, &format!("{:.2} s{apart}", frame as f64 * replay.dt), 13)?;
        }
        area.present().map_err(failed)
    }
}
