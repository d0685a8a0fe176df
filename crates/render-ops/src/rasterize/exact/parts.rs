//! Visible parts of a pixel's faces: their sides, and where they lie.

use bokashi_core::Scalar;

use super::extent::{Extent, Spread};
use super::pixel_border::clipped;
use super::polygon::{BORDER, Line, Polygon, Polygons};

/// Where a line comes from: faces by their positions among those of the band.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// Edge k of a face.
    Edge { band_face: u32, k: u8 },
    /// Where a face's depth is -1 or 1.
    End { band_face: u32, is_far: bool },
    /// The depth of the second less that of the first.
    Between { first: u32, second: u32 },
}

/// A side of what is visible of a candidate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side<S> {
    pub(super) source: Source,
    pub(super) is_inside: bool,
    /// Whether it lies on the pixel's border, which it shares with another pixel.
    pub(super) is_on_border: bool,
    /// The line's normal.
    pub(super) normal: [S; 2],
    pub(super) ends: [[S; 2]; 2],
}

impl<S> Side<S> {
    /// How often it counts, negative where its candidate is on the line's outside.
    #[inline(always)]
    pub(super) fn share(&self) -> f64 {
        let share = if self.is_on_border { 0.5 } else { 1.0 };
        if self.is_inside { share } else { -share }
    }
}

/// A visible part of a candidate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part<S> {
    pub(super) candidate: u32,
    pub(super) polygon: Polygon,
    pub(super) area: S,
}

/// Visible parts, with the lines that bound them; and all polygons and lines on the way to them.
#[derive(Debug, Default)]
pub(super) struct Parts<S> {
    pub(super) parts: Vec<Part<S>>,
    pub(super) polygons: Polygons<S>,
    pub(super) lines: Vec<Line<S>>,
    /// Per line: where it comes from, and whether it lies on the pixel's border.
    pub(super) sources: Vec<(Source, bool)>,
    /// Whether some line does.
    pub(super) touches_border: bool,
}

impl<S: Scalar> Parts<S> {
    pub(super) fn clear(&mut self) {
        self.parts.clear();
        self.polygons.clear();
        self.lines.clear();
        self.sources.clear();
        self.touches_border = false;
    }

    /// Adds the parts of others, and of their lines and polygons what belongs to them; returns how many
    /// parts there are.
    pub(super) fn append(&mut self, others: &Self) -> usize {
        let Self { parts, polygons, lines, sources, touches_border } = self;
        // Per line of the others: its name here.
        let mut names = vec![BORDER; others.lines.len()];
        parts.extend(others.parts.iter().map(|part| {
            let polygon = polygons.copy_of(&others.polygons, part.polygon, |line| {
                let line = line as usize;
                if names[line] == BORDER {
                    // Lines of polygons that are not kept stay behind.
                    names[line] = lines.len() as u32;
                    lines.push(others.lines[line]);
                    sources.push(others.sources[line]);
                }
                names[line]
            });
            Part { polygon, ..*part }
        }));
        *touches_border |= others.touches_border;
        others.parts.len()
    }

    /// Adds a part of a candidate that is known at one point alone.
    pub(super) fn add_sample(&mut self, candidate: u32, point: [S; 2], area: S) {
        let polygon = self.polygons.point(point);
        self.parts.push(Part { candidate, polygon, area });
    }

    /// Puts the parts of each candidate side by side.
    pub(super) fn sort(&mut self) {
        self.parts.sort_by_key(|part| part.candidate);
    }

    /// The parts of each candidate, where they lie side by side.
    #[inline(always)]
    pub(super) fn by_candidate(&self) -> impl Iterator<Item = &[Part<S>]> {
        self.parts.chunk_by(|a, b| a.candidate == b.candidate)
    }

    /// Calls `visit` with each candidate and the sides of its parts: lines, not the borders of cells.
    #[inline(always)]
    pub(super) fn for_each_side(&self, mut visit: impl FnMut(u32, Side<S>)) {
        for part in &self.parts {
            for (bound, ends) in self.polygons.segments(part.polygon) {
                if bound.line() == BORDER {
                    continue;
                }
                let index = bound.line() as usize;
                let [_, x, y] = self.lines[index];
                let ((source, is_on_border), is_inside) = (self.sources[index], bound.is_inside());
                let side = Side { source, is_inside, is_on_border, normal: [x, y], ends };
                visit(part.candidate, side);
            }
        }
    }

    /// Adds the sides that lie on the pixel's border, clipped to it, with their candidates.
    #[cold]
    pub(super) fn add_border_sides(&self, sides: &mut Vec<(u32, Side<S>)>) {
        self.for_each_side(|candidate, side| {
            if side.is_on_border {
                let ends = clipped(side.ends, side.normal);
                sides.extend(ends.map(|ends| (candidate, Side { ends, ..side })));
            }
        });
    }

    /// The extent of `parts`, whose area is `area`, under the density 1 / t; where it `spreads`,
    /// all of it.
    #[inline(always)]
    pub(super) fn extent(
        &self,
        parts: &[Part<S>],
        area: S,
        t: Line<S>,
        spreads: bool,
    ) -> Option<Extent<S>> {
        let spread = self.spread(parts, Spread::new(t), spreads);
        if spread.reaches_far {
            return self.spread(parts, Spread::raised(t), spreads).extent(area);
        }
        spread.extent(area)
    }

    #[inline(always)]
    fn spread(&self, parts: &[Part<S>], mut spread: Spread<S>, spreads: bool) -> Spread<S> {
        for part in parts {
            let (corner, fan) = self.polygons.fan(part.polygon);
            if spreads {
                spread.add_fan::<true>(corner, fan, part.area);
            } else {
                spread.add_fan::<false>(corner, fan, part.area);
            }
        }
        spread
    }
}
