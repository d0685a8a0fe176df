//! Sheets: faces of a pixel that hang together across edges that are no outline.
//!
//! Let none of a sheet's faces end in the pixel. Where one of its edges crosses the pixel, the sheet
//! goes on beyond that edge. So it has no border in the pixel, and fills the pixel if it covers any
//! point there. Behind or before it no outline parts the surface from the background.

use bokashi_core::Scalar;

use super::band_faces::BandFaces;
use super::depth_intervals::DepthInterval;

/// The memory of the search.
#[derive(Debug, Default)]
pub(super) struct Sheets {
    is_known: Vec<bool>,
    open: Vec<usize>,
}

impl Sheets {
    /// Whether a sheet surely fills the pixel that `faces` of the band, in order, may reach into.
    /// `intervals` are theirs, and `outlines` those of all faces of the band.
    #[inline(always)]
    pub(super) fn fill<T: Scalar>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        outlines: &[u8],
        faces: &[u32],
        intervals: &[DepthInterval<T::Wide>],
    ) -> bool {
        let Self { is_known, open } = self;
        is_known.clear();
        is_known.resize(faces.len(), false);
        let adjacency = band.view.mesh.adjacency();
        for first in 0..faces.len() {
            if is_known[first] || !intervals[first].covers {
                continue;
            }
            let mut has_border = false;
            is_known[first] = true;
            open.push(first);
            while let Some(at) = open.pop() {
                has_border |= intervals[at].ends || !intervals[at].is_within();
                let band_face = faces[at] as usize;
                for corner in (0..3).filter(|corner| outlines[band_face] >> corner & 1 == 0) {
                    let neighbor = adjacency.neighbor(band.faces[band_face] as usize, corner);
                    let beyond = neighbor.and_then(|neighbor| {
                        let band_face = band.faces.binary_search(&neighbor.face).ok()?;
                        faces.binary_search(&(band_face as u32)).ok()
                    });
                    // A face that does not reach into the pixel is none of its faces.
                    if let Some(at) = beyond.filter(|&at| !is_known[at]) {
                        is_known[at] = true;
                        open.push(at);
                    }
                }
            }
            if !has_border {
                return true;
            }
        }
        false
    }
}
