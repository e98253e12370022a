//! Several replays as one moving picture: each in a cell of its own, the truth beside NeRD.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use super::plot::failed;
use super::replay::Replay;
use super::scene;
use crate::error::{Error, Result};

/// Size of a tile (px), of which a cell has two, and of the line above it.
const TILE: (u32, u32) = (130, 120);
const LINE: u32 = 22;
/// Cells in a row.
const COLUMNS: usize = 3;
/// Pictures a second.
const RATE: f64 = 15.0;

/// Writes replays as a GIF of so many seconds.
///
/// # Errors
/// If it cannot be drawn or written.
pub fn gif(replays: &[Replay], seconds: f64, path: &Path) -> Result<()> {
    register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular())
        .map_err(|_| Error::Draw("the built-in font cannot be read".into()))?;
    let rows = replays.len().div_ceil(COLUMNS);
    let (cell, high) = (2 * TILE.0, TILE.1 + LINE);
    let size = (cell * COLUMNS as u32, high * rows as u32);
    let folder = tempfile::tempdir().map_err(Error::file(Path::new("a temporary folder")))?;
    let draft = folder.path().join("film.gif");
    let backend = BitMapBackend::gif(&draft, size, (1000.0 / RATE) as u32).map_err(|e| Error::Draw(e.to_string()))?;
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
                    scene::draw(replay, track, frame, &tile)?;
                }
            }
        }
        area.present().map_err(failed::<BitMapBackend>)?;
    }
    drop(area);
    super::write(path, &std::fs::read(&draft).map_err(Error::file(&draft))?)
}
