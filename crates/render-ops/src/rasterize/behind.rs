//! The surface behind a surface: depth peeling.
//!
//! A pixel sees the nearest face that is behind the face that it saw in the layer before: at a larger
//! depth, or at the same depth with a larger index. So every face that covers the pixel is seen in one
//! layer, and none in two. Depths are compared as they are computed for visibility, to the last bit.
//!
//! # Source
//! Everitt, *Interactive order-independent transparency*, NVIDIA 2001.

use std::ops::Range;

use bokashi_core::Scalar;

use super::culling::{Fate, Verdict};
use super::prepared::Prepared;
use super::setup::{Setup, Weights, beyond};
use crate::coverage::Coverage;

/// Stands for "no face" in a row.
const NO_FACE: u64 = u64::MAX;

/// Memory for the depths of one face, and of the layer in front.
#[derive(Debug)]
pub(super) struct Peeling<S> {
    /// A row of one face.
    depths: Vec<S>,
    faces: Vec<u64>,
    /// Per pixel of a band: the depth of the layer in front, which nothing is behind where there is
    /// none.
    front: Vec<S>,
    /// Per pixel of a band: the face of the layer in front.
    front_faces: Vec<u32>,
}

impl<S> Default for Peeling<S> {
    fn default() -> Self {
        let (depths, faces, front, front_faces) = Default::default();
        Self { depths, faces, front, front_faces }
    }
}

/// The depths and faces that a band's pixels have found so far, row by row.
pub(super) struct DrawnLayer<'a, S> {
    pub(super) depths: &'a mut [S],
    /// Positions among the band's faces.
    pub(super) faces: &'a mut [u64],
    /// Entries of a row.
    pub(super) stride: usize,
    /// Per row: the columns, first and end, that were reached.
    pub(super) reached: &'a mut [[usize; 2]],
}

impl<S: Scalar<Wide = S>> Peeling<S> {
    /// Draws the layer behind `front` into the band of `rows`, whose faces are `faces`.
    pub(super) fn draw<T: Scalar<Wide = S>>(
        &mut self,
        view: &Prepared<'_, T>,
        front: &Coverage,
        rows: Range<usize>,
        faces: &[u32],
        mut layer: DrawnLayer<'_, S>,
        weights: &mut Vec<Weights<S>>,
    ) {
        let width = view.size.width;
        self.depths.clear();
        self.depths.resize(width, beyond());
        self.faces.clear();
        self.faces.resize(width, NO_FACE);
        self.find_front(view, front, rows.clone());
        for (number, &face) in (0..).zip(faces) {
            let Verdict { fate, .. } = view.verdicts[face as usize];
            let Fate::Drawn { columns: [left, right], rows: [top, bottom] } = fate else {
                unreachable!("only faces that are drawn are on the lists");
            };
            let mut setup = setup_of(view, face as usize);
            let columns = [left as usize, right as usize + 1];
            for row in rows.start.max(top as usize)..rows.end.min(bottom as usize + 1) {
                let [first, end] = self.cover(view, &mut setup, row, columns);
                self.keep_nearest(
                    row - rows.start,
                    [first, end],
                    (number, face),
                    width,
                    &mut layer,
                );
            }
            weights.push(setup.weights());
        }
    }

    /// Finds the depths of the layer in front, face by face, and forgets those of the band before.
    fn find_front<T: Scalar<Wide = S>>(
        &mut self,
        view: &Prepared<'_, T>,
        front: &Coverage,
        rows: Range<usize>,
    ) {
        let width = view.size.width;
        let count = rows.len() * width;
        self.front.clear();
        self.front.resize(count, beyond());
        self.front_faces.clear();
        self.front_faces.resize(count, 0);
        let band = rows.start / view.rows;
        for slot in front.centers.slots_of(band..band + 1) {
            let face = front.centers.face(slot);
            let mut setup = setup_of(view, face);
            for run in front.centers.in_slot(slot) {
                let pixels = run.pixels();
                let (row, column) = (pixels.start / width, pixels.start % width);
                let columns = [column, column + pixels.len()];
                let [first, end] = self.cover(view, &mut setup, row, columns);
                let within = (row - rows.start) * width;
                for column in columns[0]..columns[1] {
                    self.front[within + column] = self.depths[column];
                    self.front_faces[within + column] = face as u32;
                }
                self.forget(first, end);
            }
        }
    }

    /// Draws a row of a face among `columns`, first and end; returns those that it reached.
    fn cover<T: Scalar<Wide = S>>(
        &mut self,
        view: &Prepared<'_, T>,
        setup: &mut Setup<S>,
        row: usize,
        columns: [usize; 2],
    ) -> [usize; 2] {
        let centers = &view.centers[..view.size.width];
        let edges = setup.row(view.ys[row]);
        setup.cover_span(&edges, columns, centers, &mut self.depths, &mut self.faces, 0)
    }

    /// Keeps what the row of a face shows, where it is behind the layer in front and before what was
    /// found there, and forgets the row.
    fn keep_nearest(
        &mut self,
        row: usize,
        [first, end]: [usize; 2],
        (number, face): (u64, u32),
        width: usize,
        layer: &mut DrawnLayer<'_, S>,
    ) {
        if first >= end {
            return;
        }
        let [stored, within] = [row * layer.stride, row * width];
        for column in first..end {
            if self.faces[column] == NO_FACE {
                continue;
            }
            let depth = self.depths[column];
            let (front, before) = (self.front[within + column], self.front_faces[within + column]);
            // Of equal depths the lower face was seen in front.
            let is_behind = depth > front || depth == front && face > before;
            // Faces come in order, so of equal depths the lower one stays.
            if is_behind && depth < layer.depths[stored + column] {
                layer.depths[stored + column] = depth;
                layer.faces[stored + column] = number;
            }
        }
        let reached = &mut layer.reached[row];
        *reached = [reached[0].min(first), reached[1].max(end)];
        self.forget(first, end);
    }

    fn forget(&mut self, first: usize, end: usize) {
        if first < end {
            self.depths[first..end].fill(beyond());
            self.faces[first..end].fill(NO_FACE);
        }
    }
}

fn setup_of<T: Scalar>(view: &Prepared<'_, T>, face: usize) -> Setup<T::Wide> {
    Setup::new(view.corners_of(face), view.verdicts[face].orientation, view.size)
}
