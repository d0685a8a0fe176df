//! Which face each pixel centre sees.
//!
//! The image is cut into bands of rows. Each band has a list of the faces that can touch it, in
//! the order of their indices, and keeps the nearest sample per pixel; of equal depths the lower
//! face index wins, since it came first. Bands are independent of each other, and their fragments
//! are joined in order, so that nothing depends on the number of threads.

use bokashi_core::Scalar;
use bokashi_core::parallel::for_each_item_mut;

use super::RasterOptions;
use super::setup::{Sample, Setup};
use crate::fragments::Culled;
use crate::mesh::Mesh;
use crate::size::Size;

/// Pixels in one band, rounded to whole rows: enough work to be worth a thread.
const PIXELS_PER_BAND: usize = 1 << 14;

/// The stages of rasterization, with their memory, which the next step uses again.
#[derive(Debug)]
pub(super) struct Visibility<S> {
    setups: Vec<Setup<S>>,
    bands: Vec<Band<S>>,
}

impl<S> Default for Visibility<S> {
    fn default() -> Self {
        Self { setups: Vec::new(), bands: Vec::new() }
    }
}

/// A band of rows.
#[derive(Debug)]
pub(super) struct Band<S> {
    /// Positions in the list of setups.
    setups: Vec<u32>,
    /// Per pixel: the nearest sample so far and its face.
    nearest: Vec<Option<(u32, Sample<S>)>>,
    /// The covered pixels, in order, with what they see.
    pub(super) fragments: Vec<Fragment<S>>,
}

/// A covered pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fragment<S> {
    pub(super) pixel: u32,
    pub(super) face: u32,
    pub(super) sample: Sample<S>,
}

impl<S: Scalar<Wide = S>> Visibility<S> {
    /// Finds the fragments of each band; they are left in the bands.
    pub(super) fn run<T: Scalar<Wide = S>>(
        &mut self,
        clip: &[T],
        mesh: &Mesh,
        options: RasterOptions,
    ) -> (&[Band<S>], Culled) {
        let mut culled = Culled::default();
        self.setups.clear();
        self.setups.extend(
            (0..mesh.faces().len())
                .filter_map(|face| Setup::of(clip, mesh, face, options, &mut culled)),
        );

        let size = options.size;
        let band_rows = PIXELS_PER_BAND.div_ceil(size.width);
        let band_count = size.height.div_ceil(band_rows);
        self.bands.resize_with(band_count, || Band {
            setups: Vec::new(),
            nearest: Vec::new(),
            fragments: Vec::new(),
        });
        self.bands.iter_mut().for_each(|band| band.setups.clear());
        for (at, setup) in (0..).zip(&self.setups) {
            for band in &mut self.bands[setup.rows[0] / band_rows..=setup.rows[1] / band_rows] {
                band.setups.push(at);
            }
        }
        let setups = &self.setups;
        for_each_item_mut(&mut self.bands, |k, band| {
            let first_row = k * band_rows;
            let last_row = (first_row + band_rows).min(size.height) - 1;
            band.run(setups, size, [first_row, last_row]);
        });
        (&self.bands, culled)
    }
}

impl<S: Scalar<Wide = S>> Band<S> {
    fn run(&mut self, setups: &[Setup<S>], size: Size, rows: [usize; 2]) {
        let Self { setups: own, nearest, fragments } = self;
        nearest.clear();
        nearest.resize((rows[1] + 1 - rows[0]) * size.width, None);
        for setup in own.iter().map(|&at| &setups[at as usize]) {
            let [left, right] = setup.columns;
            for row in setup.rows[0].max(rows[0])..=setup.rows[1].min(rows[1]) {
                let shared = setup.row(size.center_y(row));
                let first = (row - rows[0]) * size.width;
                for (column, nearest) in (left..).zip(&mut nearest[first + left..=first + right]) {
                    let Some(sample) = setup.sample(&shared, size.center_x(column)) else {
                        continue;
                    };
                    if nearest.is_none_or(|(_, other)| sample.depth < other.depth) {
                        *nearest = Some((setup.face, sample));
                    }
                }
            }
        }
        fragments.clear();
        let first_pixel = (rows[0] * size.width) as u32;
        fragments.extend((first_pixel..).zip(nearest.iter()).filter_map(|(pixel, nearest)| {
            nearest.map(|(face, sample)| Fragment { pixel, face, sample })
        }));
    }
}
