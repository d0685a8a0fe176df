//! Positions far from the origin, such as those of maps.
//!
//! Numbers of `f32` have 24 bits. At a northing of 4,649,776 metres, positions are half a metre apart. So
//! files of text and of doubles are read as `f64`. Where they lie far from the origin, an offset of whole
//! numbers is taken off before they are rounded. The mesh's place in the world has it, and so has what is
//! written.

use glam::DVec3;

use crate::mesh::notes::Notes;
use crate::model::far_offset;

/// Positions without their offset.
#[derive(Debug, Default)]
pub(super) struct Near {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) offset: DVec3,
}

impl Near {
    /// Those of `positions`; the vertices that are `named` say whether they are far.
    pub(super) fn new(
        positions: &[[f64; 3]],
        named: impl Iterator<Item = u32>,
        notes: &mut Notes,
    ) -> Self {
        let bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let offset = far_offset(named.fold(bounds, |[least, most], vertex| {
            let position = DVec3::from(positions[vertex as usize]);
            [least.min(position), most.max(position)]
        }));
        if offset != DVec3::ZERO {
            notes.add(format!(
                "positions lie far from the origin: {:?} was taken off them, and what is written has it again",
                offset.to_array()
            ));
        }
        let near = |&position: &[f64; 3]| (DVec3::from(position) - offset).as_vec3().to_array();
        Self { positions: positions.iter().map(near).collect(), offset }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn without_offset(positions: &[[f64; 3]]) -> (Near, usize) {
        let mut notes = Notes::default();
        let near = Near::new(positions, 0..positions.len() as u32, &mut notes);
        (near, notes.finish().len())
    }

    #[test]
    fn positions_far_from_the_origin_lose_an_offset_of_whole_numbers_and_no_bits() {
        let (near, notes) =
            without_offset(&[[500_000.25, 4_649_776.0, 100.0], [500_001.0, 4_649_776.125, 99.5]]);
        assert_eq!(near.offset.to_array(), [500_001.0, 4_649_776.0, 100.0]);
        assert_eq!(near.positions, [[-0.75, 0.0, 0.0], [0.0, 0.125, -0.5]]);
        assert_eq!(notes, 1);
        // Beyond 2^24 it is a number that f32 has.
        let (near, _) = without_offset(&[[20_000_001.5, 0.0, 0.0], [20_000_004.5, 1.0, 0.0]]);
        assert_eq!(f64::from(near.offset.x as f32), near.offset.x);
        assert_eq!(f64::from(near.positions[0][0]) + near.offset.x, 20_000_001.5);
    }

    #[test]
    fn positions_near_the_origin_stay_as_they_are() {
        let rows = [[15.0, 0.1, 0.0], [16.0, 0.0, 0.0]];
        let (near, notes) = without_offset(&rows);
        assert_eq!(near.positions, rows.map(|row| row.map(|x| x as f32)));
        assert_eq!((near.offset, notes), (DVec3::ZERO, 0));
        for rows in
            [&[[f64::NAN, 1e9, 1e9]; 3][..], &[[f64::INFINITY; 3]; 2], &[[1e300; 3]; 2], &[]]
        {
            assert_eq!(without_offset(rows).1, 0);
        }
    }
}
