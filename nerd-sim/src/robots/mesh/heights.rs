//! Reads height fields from PNG and from MuJoCo's binary format.

use std::io::Cursor;

use super::file::{MAX_VERTICES, bytes_of};
use crate::internal::*;

/// Reads `[rows, columns]` and heights `[row][column]`, in the file's own unit. The last row of a picture comes first.
pub(crate) fn heights(path: &Path) -> Result<([usize; 2], Vec<f32>), String> {
    let bytes = bytes_of(path)?;
    let picture = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png"));
    if picture { pixels(bytes) } else { own(&bytes) }
}

/// Grey value or red channel in 8 bits: 16-bit values lose their lower byte, as in MuJoCo.
fn pixels(bytes: Vec<u8>) -> Result<([usize; 2], Vec<f32>), String> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let (ncol, nrow) = (reader.info().width as usize, reader.info().height as usize);
    if nrow.checked_mul(ncol).is_none_or(|n| n > MAX_VERTICES) {
        return Err(format!("has more than {MAX_VERTICES} pixels"));
    }
    let mut pixels = vec![0; reader.output_buffer_size().ok_or("is too large")?];
    let frame = reader.next_frame(&mut pixels).map_err(|e| e.to_string())?;
    let line = frame.line_size;
    let wide = frame.color_type.samples();
    let pixels = &pixels;
    let row = |row: usize| (0..ncol).map(move |column| f32::from(pixels[row * line + column * wide]));
    Ok(([nrow, ncol], (0..nrow).rev().flat_map(row).collect()))
}

/// MuJoCo's format: rows and columns as 32-bit integers, then heights as 32-bit floats; a picture's last row comes
/// first.
fn own(bytes: &[u8]) -> Result<([usize; 2], Vec<f32>), String> {
    let words: Vec<[u8; 4]> = bytes.chunks(4).map_while(|word| word.try_into().ok()).collect();
    let size = |k: usize| words.get(k).map_or(0, |word| i32::from_le_bytes(*word).max(0) as usize);
    let [nrow, ncol] = [size(0), size(1)];
    if nrow.checked_mul(ncol).is_none_or(|n| n == 0 || n > MAX_VERTICES || bytes.len() != 8 + 4 * n) {
        return Err(format!("is no height field: {} bytes for {nrow} rows of {ncol}", bytes.len()));
    }
    Ok(([nrow, ncol], words[2..].iter().map(|word| f32::from_le_bytes(*word)).collect()))
}
