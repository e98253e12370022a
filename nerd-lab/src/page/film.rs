//! The moving picture of README: several replays at once, each in a cell of its own, the truth beside NeRD. The page's painter
//! draws it, in a browser without a window.

use std::process::Command;

use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, GenericImageView};
use serde_json::json;

use crate::{error, prelude::*};
use nerd_train::replay::{self, Replay};

const PAGE: &str = include_str!("film.html");
/// Size of a tile (px), of which a cell has two, and of the line above it; cells in a row.
const TILE: (u32, u32) = (130, 120);
const LINE: u32 = 22;
const CELLS: u32 = 4;
/// Pictures a second, and in a row of the sheet that the browser draws.
const RATE: u32 = 15;
const SHEET: u32 = 4;
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

pub fn gif(replays: &[Replay], seconds: u32, path: &Path) -> Result<()> {
    let (pictures, rows) = (seconds * RATE, (replays.len() as u32).div_ceil(CELLS));
    let (wide, high) = (2 * TILE.0 * CELLS, (TILE.1 + LINE) * rows);
    let data = json!({
        "replays": replays, "pictures": pictures, "rate": RATE, "sheet": SHEET, "tile": [TILE.0, TILE.1], "line": LINE, "cells": CELLS,
    });
    let page = PAGE.replace("SCRIPT", replay::SCRIPT).replace("DATA", &replay::script(&data));
    let sheet = screenshot(&page, (wide * SHEET, high * pictures.div_ceil(SHEET)))?;
    let mut bytes = Vec::new();
    let mut encoder = GifEncoder::new_with_speed(&mut bytes, 10);
    encoder.set_repeat(Repeat::Infinite)?;
    for k in 0..pictures {
        let picture = sheet.view(k % SHEET * wide, k / SHEET * high, wide, high).to_image();
        encoder.encode_frame(Frame::from_parts(picture, 0, 0, Delay::from_numer_denom_ms(1000, RATE)))?;
    }
    drop(encoder);
    write(path, &bytes)
}

/// What a browser shows of a page in a window of this size.
fn screenshot(page: &str, (width, height): (u32, u32)) -> Result<image::DynamicImage> {
    let starts = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|found| found.status.success());
    let Some(browser) = BROWSERS.into_iter().find(starts) else { bail!("a film needs a browser: one of {}", BROWSERS.join(", ")) };
    let folder = tempfile::tempdir().map_err(error::file(Path::new("a temporary folder")))?;
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    write(&at("film.html"), page.as_bytes())?;
    let run = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--force-device-scale-factor=1", "--no-first-run"])
        .arg(format!("--window-size={width},{height}"))
        .arg(format!("--screenshot={}", at("film.png").display()))
        .arg(format!("--user-data-dir={}", at("profile").display()))
        .arg(format!("file://{}", at("film.html").display()))
        .output()?;
    match image::open(at("film.png")) {
        Ok(sheet) if sheet.dimensions() == (width, height) => Ok(sheet),
        _ => bail!("{browser} drew no film: {}", String::from_utf8_lossy(&run.stderr).lines().last().unwrap_or_default()),
    }
}
