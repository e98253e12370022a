//! Pictures as pixels: twice as fine as they are large, for sharp screens, and with letters set by the font's own measures.
//! (plotters draws each glyph without its left bearing and at whole pixels, so that words fall apart.)

use std::path::Path;

use ab_glyph::{Font, FontRef, Glyph, ScaleFont, point};
use plotters::prelude::BitMapBackend;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind};

/// Pixels by unit of length.
const FINE: i32 = 2;
/// plotters' size of a font by its em, as its SVG has it.
const EM: f32 = 1.24;

/// What is drawn on; a unit of length is a pixel of plotters.
pub(super) struct Canvas<'a> {
    pixels: BitMapBackend<'a>,
    font: FontRef<'static>,
}

type Error<'a> = DrawingErrorKind<<BitMapBackend<'a> as DrawingBackend>::ErrorType>;

/// A style with thicker strokes.
struct Thick<'a, S>(&'a S);

impl<S: BackendStyle> BackendStyle for Thick<'_, S> {
    fn color(&self) -> BackendColor {
        self.0.color()
    }

    fn stroke_width(&self) -> u32 {
        self.0.stroke_width() * FINE as u32
    }
}

fn fine((x, y): BackendCoord) -> BackendCoord {
    (x * FINE, y * FINE)
}

impl<'a> Canvas<'a> {
    /// For a PNG file; `font` are the bytes of a TTF.
    pub(super) fn new(file: &'a Path, (w, h): (u32, u32), font: &'static [u8]) -> Result<Self, ab_glyph::InvalidFont> {
        let pixels = BitMapBackend::new(file, (w * FINE as u32, h * FINE as u32));
        Ok(Self { pixels, font: FontRef::try_from_slice(font)? })
    }

    /// Glyphs of a line from (0, 0) on its baseline, and its width.
    fn set(&self, text: &str, size: f32) -> (Vec<Glyph>, f32) {
        let height = self.font.height_unscaled() / self.font.units_per_em().unwrap_or(1000.0);
        let font = self.font.as_scaled(size / EM * height * FINE as f32);
        let (mut x, mut before, mut glyphs) = (0.0, None, Vec::new());
        for id in text.chars().map(|c| font.glyph_id(c)) {
            x += before.map_or(0.0, |before| font.kern(before, id));
            glyphs.push(id.with_scale_and_position(font.scale(), point(x, 0.0)));
            x += font.h_advance(id);
            before = Some(id);
        }
        (glyphs, x)
    }
}

impl<'a> DrawingBackend for Canvas<'a> {
    type ErrorType = <BitMapBackend<'a> as DrawingBackend>::ErrorType;

    fn get_size(&self) -> (u32, u32) {
        let (w, h) = self.pixels.get_size();
        (w / FINE as u32, h / FINE as u32)
    }

    fn ensure_prepared(&mut self) -> Result<(), Error<'a>> {
        self.pixels.ensure_prepared()
    }

    fn present(&mut self) -> Result<(), Error<'a>> {
        self.pixels.present()
    }

    fn draw_pixel(&mut self, at: BackendCoord, color: BackendColor) -> Result<(), Error<'a>> {
        let (x, y) = fine(at);
        self.pixels.draw_rect((x, y), (x + FINE - 1, y + FINE - 1), &color, true)
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Result<(), Error<'a>> {
        self.pixels.draw_line(fine(from), fine(to), &Thick(style))
    }

    fn draw_rect<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S, fill: bool) -> Result<(), Error<'a>> {
        self.pixels.draw_rect(fine(from), fine(to), &Thick(style), fill)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, path: I, style: &S) -> Result<(), Error<'a>> {
        self.pixels.draw_path(path.into_iter().map(fine), &Thick(style))
    }

    fn draw_circle<S: BackendStyle>(&mut self, at: BackendCoord, radius: u32, style: &S, fill: bool) -> Result<(), Error<'a>> {
        self.pixels.draw_circle(fine(at), radius * FINE as u32, &Thick(style), fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, corners: I, style: &S) -> Result<(), Error<'a>> {
        self.pixels.fill_polygon(corners.into_iter().map(fine), style)
    }

    fn draw_text<T: BackendTextStyle>(&mut self, text: &str, style: &T, at: BackendCoord) -> Result<(), Error<'a>> {
        let (color, turn, size) = (style.color(), style.transform(), style.size() as f32);
        let (glyphs, width) = self.set(text, size);
        let em = size / EM * FINE as f32;
        // As in the SVG: `dy` of 0.76 em and half an ex.
        let left = match style.anchor().h_pos {
            HPos::Left => 0.0,
            HPos::Right => -width,
            HPos::Center => -width / 2.0,
        };
        let down = em
            * match style.anchor().v_pos {
                VPos::Top => 0.76,
                VPos::Center => 0.27,
                VPos::Bottom => -0.27,
            };
        let ((x, y), (w, h)) = (fine(at), self.pixels.get_size());
        for mut glyph in glyphs {
            glyph.position += point(left, down);
            let Some(outline) = self.font.outline_glyph(glyph) else { continue };
            let corner = outline.px_bounds().min;
            let mut dots = Vec::new();
            outline.draw(|a, b, share| dots.push((corner.x as i32 + a as i32, corner.y as i32 + b as i32, share)));
            for (a, b, share) in dots {
                let (a, b) = turn.transform(a, b);
                let (a, b) = (x + a, y + b);
                if (0..w as i32).contains(&a) && (0..h as i32).contains(&b) {
                    self.pixels.draw_pixel((a, b), BackendColor { alpha: color.alpha * f64::from(share.min(1.0)), ..color })?;
                }
            }
        }
        Ok(())
    }
}
