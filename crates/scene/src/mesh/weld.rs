//! Raw meshes of files become geometries. Where it is asked for, vertices in one place become one vertex. So no
//! seam of a texture or between materials tears when they move.
//!
//! Two rows of numbers are one where their bits are the same, with -0 as 0. Positions keep the order of
//! the file, and so their numbers where none is left out. Rows of attributes come in the order in which
//! the corners of the faces first name them. So what comes out depends only on what stands at the corners
//! and on the order of the vertices, not on how a format indexes its attributes.
//!
//! Where it is not asked for, two positions are one where the file has one row for both. A note counts the
//! vertices that lie where another one does.
//!
//! Left out are faces that name a vertex twice, and vertices that no face names. A submesh loses an attribute
//! with a number that is not finite, or with a normal or a tangent of length 0. A position that is not finite is
//! an error.
//!
//! Submeshes of one material that carry the same attributes are one, in the order in which they come first.

use std::borrow::Cow;
use std::collections::HashMap;
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hash};
use std::ops::Range;

use bokashi_render_ops::edges::repeats_a_vertex;
use glam::DVec3;

use crate::error::{Location, SceneError};
use crate::mesh::notes::Notes;
use crate::model::{Geometry, Indexed, NO_ROW, Submesh};

/// The number of no row.
const NONE: u32 = u32::MAX;
/// A squared length that differs from 1 by less is that of a unit vector of `f32`, which stays as it is.
const UNIT_TOLERANCE: f64 = 1e-6;

/// Rows of numbers, and for each face the rows at its corners: [`NO_ROW`] at all corners of a submesh
/// that has none.
#[derive(Debug, Clone)]
pub(super) struct Corners<'a, const N: usize> {
    pub(super) rows: &'a [[f32; N]],
    pub(super) faces: Cow<'a, [[u32; 3]]>,
}

/// A mesh as a file has it. The rows may be those of other meshes too; faces name none beyond them.
#[derive(Debug, Clone)]
pub(super) struct Raw<'a> {
    pub(super) name: String,
    pub(super) submeshes: Vec<Submesh>,
    /// Whether positions with the same bits are one. Else those of one row are.
    pub(super) is_welded: bool,
    pub(super) positions: Corners<'a, 3>,
    pub(super) colors: Option<Corners<'a, 3>>,
    pub(super) coordinates: Option<Corners<'a, 2>>,
    pub(super) normals: Option<Corners<'a, 3>>,
    pub(super) tangents: Option<Corners<'a, 4>>,
}

/// Welds meshes, one after the other.
#[derive(Debug, Default)]
pub(super) struct Welder {
    /// For each row of the file its number among those of a mesh, and when that was set.
    numbers: Vec<(u64, u32)>,
    /// How often rows were picked.
    round: u64,
}

impl Welder {
    /// The welded mesh, or nothing where no face is left.
    ///
    /// In one piece: faces that are left out take their rows and submeshes with them.
    pub(super) fn weld(
        &mut self,
        raw: Raw<'_>,
        location: &Location,
        notes: &mut Notes,
    ) -> Result<Option<Geometry>, SceneError> {
        let Raw { name, submeshes, is_welded, positions, .. } = raw;
        let (positions, mut local) = self.positions(&positions, location)?;
        let same = same_rows(&positions);
        if is_welded {
            local.iter_mut().flatten().for_each(|number| *number = same[*number as usize]);
        } else {
            let doubled = same.iter().enumerate().filter(|&(row, &first)| row != first as usize);
            notes.count(
                "a vertex lies where another one does, and is not joined with it",
                doubled.count(),
            );
        }
        let kept: Vec<bool> = local.iter().map(|face| !repeats_a_vertex(*face)).collect();
        let left_out = kept.iter().filter(|&&kept| !kept).count();
        notes.count("a face that names a vertex twice was left out", left_out);
        if left_out == kept.len() {
            return Ok(None);
        }
        let mut local = kept_faces(&local, &kept);
        let positions = named_only(positions, &mut local);

        let submeshes = kept_submeshes(submeshes, &kept);
        let kept_parts = (kept.as_slice(), submeshes.as_slice());
        let any = |_: &Submesh| true;
        let mut colors = checked(raw.colors, kept_parts, any, plain, "colours", notes);
        let mut coordinates =
            checked(raw.coordinates, kept_parts, any, plain, "coordinates", notes);
        let mut normals = checked(raw.normals, kept_parts, any, unit, "normals", notes);
        // The format that has tangents has none without normals.
        let has_normals = |k: &Submesh| has_row(&normals, k);
        let mut tangents =
            checked(raw.tangents, kept_parts, has_normals, tangent, "tangents", notes);
        let kind = |k: &Submesh| {
            let vectors = [has_row(&colors, k), has_row(&normals, k), has_row(&tangents, k)];
            (k.material, vectors, has_row(&coordinates, k))
        };
        let kinds = submeshes.iter().map(kind).collect();
        let (submeshes, order) = joined(submeshes, kinds);
        let indices = [
            Some(&mut local),
            colors.as_mut().map(|colors| &mut colors.1),
            coordinates.as_mut().map(|coordinates| &mut coordinates.1),
            normals.as_mut().map(|normals| &mut normals.1),
            tangents.as_mut().map(|tangents| &mut tangents.1),
        ];
        let is_moved = !order.is_sorted_by_key(|faces| faces.start);
        for faces in indices.into_iter().flatten().filter(|_| is_moved) {
            *faces = order.iter().flat_map(|range| faces[range.clone()].iter().copied()).collect();
        }
        let colors = self.numbered(colors, plain);
        let coordinates = self.numbered(coordinates, plain);
        let normals = self.numbered(normals, unit);
        let tangents = self.numbered(tangents, tangent);
        let (faces, offset) = (local, DVec3::ZERO);
        Ok(Some(Geometry {
            name,
            positions,
            offset,
            faces,
            colors,
            coordinates,
            normals,
            tangents,
            submeshes,
        }))
    }

    /// The positions that faces name, in the order of the file, and the faces with their numbers.
    fn positions(
        &mut self,
        Corners { rows, faces }: &Corners<'_, 3>,
        location: &Location,
    ) -> Result<Positions, SceneError> {
        let (mut named, mut local) = self.pick(rows.len(), faces);
        // In the order of the file, where the corners had them in theirs.
        let mut order: Vec<u32> = (0..named.len() as u32).collect();
        order.sort_unstable_by_key(|&number| named[number as usize]);
        let mut places = vec![0; named.len()];
        for (position, &number) in order.iter().enumerate() {
            places[number as usize] = position as u32;
        }
        named.sort_unstable();
        local.iter_mut().flatten().for_each(|number| *number = places[*number as usize]);
        let positions: Vec<[f32; 3]> = named.iter().map(|&row| plain(rows[row as usize])).collect();
        match positions.iter().position(|row| !row.iter().all(|x| x.is_finite())) {
            None => Ok((positions, local)),
            Some(k) => {
                let found = format!("vertex {} is at {:?}", named[k], positions[k]);
                Err(SceneError::content(
                    location.clone(),
                    format!("positions are finite, and {found}"),
                ))
            }
        }
    }

    /// The welded attribute: each row that faces name once.
    fn numbered<const N: usize>(
        &mut self,
        checked: Option<Checked<'_, N>>,
        mended: impl Fn([f32; N]) -> [f32; N],
    ) -> Option<Indexed<N>> {
        let (rows, faces) = checked?;
        let (named, mut local) = self.pick(rows.len(), &faces);
        if named.is_empty() {
            return None;
        }
        let mut picked: Vec<[f32; N]> =
            named.iter().map(|&row| mended(rows[row as usize])).collect();
        let same = same_rows(&picked);
        let mut numbers = vec![NONE; picked.len()];
        let mut count = 0;
        for row in 0..picked.len() {
            if same[row] as usize == row {
                (numbers[row], picked[count]) = (count as u32, picked[row]);
                count += 1;
            }
        }
        picked.truncate(count);
        let there = local.iter_mut().flatten().filter(|row| **row != NO_ROW);
        there.for_each(|row| *row = numbers[same[*row as usize] as usize]);
        Some(Indexed { rows: picked, faces: local })
    }

    /// The rows that faces name, each once in the order of the corners, and the faces with the numbers
    /// that the rows have there.
    fn pick(&mut self, rows: usize, faces: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 3]>) {
        if self.numbers.len() < rows {
            self.numbers.resize(rows, (0, NONE));
        }
        self.round += 1;
        let mut named = Vec::new();
        let mut number = |row: u32| {
            if row == NO_ROW {
                return NO_ROW;
            }
            let (round, number) = &mut self.numbers[row as usize];
            if *round != self.round {
                (*round, *number) = (self.round, named.len() as u32);
                named.push(row);
            }
            *number
        };
        let faces = faces.iter().map(|face| face.map(&mut number)).collect();
        (named, faces)
    }
}

/// Positions, and for each face the numbers of those at its corners.
type Positions = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// Rows of an attribute, and for each face that is kept the rows at its corners.
type Checked<'a, const N: usize> = (&'a [[f32; N]], Vec<[u32; 3]>);

/// An attribute of the faces that are kept. A submesh with a row that can't be mended has none, and one that has
/// none of what belongs to it.
fn checked<'a, const N: usize>(
    corners: Option<Corners<'a, N>>,
    (kept, submeshes): (&[bool], &[Submesh]),
    has_it: impl Fn(&Submesh) -> bool,
    mended: impl Fn([f32; N]) -> [f32; N],
    what: &str,
    notes: &mut Notes,
) -> Option<Checked<'a, N>> {
    let Corners { rows, faces } = corners?;
    let mut faces = kept_faces(&faces, kept);
    for submesh in submeshes {
        let corners_of_submesh = &mut faces[submesh.faces.clone()];
        if !has_it(submesh) {
            corners_of_submesh.fill([NO_ROW; 3]);
        }
        let is_bad =
            |&row: &u32| row != NO_ROW && !mended(rows[row as usize]).iter().all(|x| x.is_finite());
        if corners_of_submesh.as_flattened().iter().any(is_bad) {
            let why = "a mesh's {} were left out: some are missing, not finite or of length 0";
            notes.add(why.replace("{}", what));
            corners_of_submesh.fill([NO_ROW; 3]);
        }
    }
    Some((rows, faces))
}

fn has_row<const N: usize>(checked: &Option<Checked<'_, N>>, submesh: &Submesh) -> bool {
    checked.as_ref().is_some_and(|(_, faces)| faces[submesh.faces.start][0] != NO_ROW)
}

/// The submeshes with those of one kind joined, in the order in which kinds come first; and the faces that then
/// stand one after another.
fn joined<K: Copy + Eq + Hash>(
    submeshes: Vec<Submesh>,
    kinds: Vec<K>,
) -> (Vec<Submesh>, Vec<Range<usize>>) {
    let mut numbers = HashMap::new();
    let mut all: Vec<(Option<usize>, Vec<Range<usize>>)> = Vec::new();
    for (submesh, kind) in submeshes.into_iter().zip(kinds) {
        let number = *numbers.entry(kind).or_insert(all.len());
        match all.get_mut(number) {
            Some((_, faces)) => faces.push(submesh.faces),
            None => all.push((submesh.material, vec![submesh.faces])),
        }
    }
    let mut end = 0;
    let joined = all.iter().map(|(material, faces)| {
        let begin = end;
        end += faces.iter().map(ExactSizeIterator::len).sum::<usize>();
        Submesh { material: *material, faces: begin..end }
    });
    let joined = joined.collect();
    (joined, all.into_iter().flat_map(|(_, faces)| faces).collect())
}

/// The faces that are kept.
fn kept_faces(faces: &[[u32; 3]], kept: &[bool]) -> Vec<[u32; 3]> {
    let faces = faces.iter().zip(kept).filter(|(_, kept)| **kept);
    faces.map(|(face, _)| *face).collect()
}

/// The faces that are kept of submeshes, without those that keep none.
fn kept_submeshes(submeshes: Vec<Submesh>, kept: &[bool]) -> Vec<Submesh> {
    let mut end = 0;
    let kept_parts = submeshes.into_iter().map(|Submesh { material, faces }| {
        let begin = end;
        end += kept[faces].iter().filter(|&&kept| kept).count();
        Submesh { material, faces: begin..end }
    });
    kept_parts.filter(|submesh| !submesh.faces.is_empty()).collect()
}

/// The positions that faces name, in their order; the faces get their new numbers.
fn named_only(mut positions: Vec<[f32; 3]>, faces: &mut [[u32; 3]]) -> Vec<[f32; 3]> {
    let mut numbers = vec![NONE; positions.len()];
    faces.iter().flatten().for_each(|&vertex| numbers[vertex as usize] = 0);
    let mut count = 0;
    for vertex in 0..positions.len() {
        if numbers[vertex] == 0 {
            (numbers[vertex], positions[count]) = (count as u32, positions[vertex]);
            count += 1;
        }
    }
    positions.truncate(count);
    faces.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
    positions
}

/// Numbers with -0 as 0.
fn plain<const N: usize>(row: [f32; N]) -> [f32; N] {
    row.map(|number| number + 0.0)
}

/// The unit vector in a direction; NaN where there is no direction.
fn unit(row: [f32; 3]) -> [f32; 3] {
    let wide = row.map(f64::from);
    let square: f64 = wide.iter().map(|number| number * number).sum();
    match (square - 1.0).abs() < UNIT_TOLERANCE {
        true => plain(row),
        false => plain(wide.map(|number| (number / square.sqrt()) as f32)),
    }
}

/// The unit vector in a direction, and a sign; NaN where there is no direction.
fn tangent([x, y, z, sign]: [f32; 4]) -> [f32; 4] {
    let [x, y, z] = unit([x, y, z]);
    [x, y, z, if sign < 0.0 { -1.0 } else { 1.0 }]
}

/// For each row the first one with the same bits.
pub(super) fn same_rows<const N: usize>(rows: &[[f32; N]]) -> Vec<u32> {
    same_keys(rows.len(), |row| rows[row].map(f32::to_bits))
}

/// For each of `count` keys the number of the first one that is equal.
///
/// A hash table by hand: twice as fast as the standard library's. Its seed is drawn at random, so that
/// nobody can write a file whose keys all collide; the result does not depend on it.
pub(super) fn same_keys<const N: usize>(count: usize, key: impl Fn(usize) -> [u32; N]) -> Vec<u32> {
    let random = RandomState::new();
    let (seed, factor) = (random.hash_one(0), random.hash_one(1) | 1);
    let mask = (2 * count).next_power_of_two() - 1;
    let mut slots = vec![NONE; mask + 1];
    let mut first = Vec::with_capacity(count);
    for number in 0..count {
        let sought = key(number);
        let mut slot = hash(sought, seed, factor) as usize & mask;
        let first_number = loop {
            match slots[slot] {
                NONE => {
                    slots[slot] = number as u32;
                    break number as u32;
                }
                first_number if key(first_number as usize) == sought => break first_number,
                _ => slot = (slot + 1) & mask,
            }
        };
        first.push(first_number);
    }
    first
}

/// Folds the 128 bits of a product to 64, once for each number.
fn hash<const N: usize>(key: [u32; N], seed: u64, factor: u64) -> u64 {
    key.into_iter().fold(seed, |hash, number| {
        let product = u128::from(hash ^ u64::from(number)) * u128::from(factor);
        product as u64 ^ (product >> 64) as u64
    })
}
