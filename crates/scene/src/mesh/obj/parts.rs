//! The parts of an OBJ file, the faces of each object with each material, and the surfaces that they make.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::iter::repeat_n;
use std::mem;
use std::str::SplitWhitespace;

use super::statements::{Statements, numbers, rest};
use crate::error::SceneError;
use crate::mesh::colors::{self, Written};
use crate::mesh::context::MeshContext;
use crate::mesh::far::Near;
use crate::mesh::notes::{Notes, left_out, name};
use crate::mesh::polygons::Polygons;
use crate::mesh::weld::{Corners, Raw};
use crate::model::{NO_ROW, Submesh};
use crate::picture::ColorSpace;

/// The most meshes of a file: one takes kilobytes, and a few letters make it.
const MOST_PARTS: usize = 100_000;
/// Stands for a colour that a vertex does not have.
const NO_COLOR: [f32; 3] = [f32::NAN; 3];
/// What a corner names, in the order of the slashes.
const NAMED: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// Faces with one material of one object.
#[derive(Debug, Default)]
pub(super) struct Part {
    /// The object's number and name.
    object: usize,
    name: String,
    /// Its number among the names of materials.
    material: Option<usize>,
    /// For each face the positions, the coordinates and the normals at its corners.
    faces: [Vec<[u32; 3]>; 3],
    /// How many corners have no coordinate, and no normal.
    missing: [usize; 2],
    polygons: Polygons,
}

/// All of an OBJ file.
#[derive(Debug, Default)]
pub(super) struct Parts {
    positions: Vec<[f64; 3]>,
    pub(super) near: Near,
    /// As many as positions, or none.
    colors: Vec<[f32; 3]>,
    coordinates: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    list: Vec<Part>,
    /// The names of the materials that are used, and those of the files that have them.
    pub(super) materials: Vec<String>,
    pub(super) libraries: Vec<String>,
    /// The largest number of each kind that a corner names, and its line.
    largest: [(u32, usize); 3],
    /// The words that begin statements which were left out.
    left_out: BTreeSet<String>,
    /// The first two smoothing groups that differ; none is "off".
    smoothing: Vec<String>,
}

impl Parts {
    /// In one piece: a match over the keywords of statements.
    pub(super) fn read(text: &str, context: &mut MeshContext<'_>) -> Result<Self, SceneError> {
        let mut parts = Self::default();
        let (mut object, mut objects, mut material) = (String::new(), 0_usize, None);
        let (mut by_name, mut by_object) = (HashMap::new(), HashMap::new());
        let mut corners = Vec::new();
        for (number, line) in Statements::new(text) {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => parts.vertex(words, number, context)?,
                Some("vt") => {
                    let location = || context.line(number);
                    let ([u, v, w], count) = numbers(words, "a texture coordinate", location)?;
                    check_count(count, 1, "a texture coordinate", number, context)?;
                    if w != 0.0_f32 {
                        context.notes.add("third texture coordinates were left out");
                    }
                    parts.coordinates.push([u, 1.0 - v]);
                }
                Some("vn") => {
                    let (normal, count) = numbers(words, "a normal", || context.line(number))?;
                    check_count(count, 3, "a normal", number, context)?;
                    parts.normals.push(normal);
                }
                Some("f" | "fo") => {
                    corners.clear();
                    parts.corners(words, &mut corners, number, context)?;
                    if corners.len() < 3 {
                        context.notes.add("a face with fewer than three corners was left out");
                        continue;
                    }
                    let key = (objects, material);
                    parts.part(key, &object, &mut by_object, number, context)?.add(&corners);
                }
                Some("o") => {
                    object = name(rest(&line, "o"));
                    objects += 1;
                }
                Some("usemtl") => {
                    let name = name(rest(&line, "usemtl"));
                    let next = parts.materials.len();
                    let index = *by_name.entry(name.clone()).or_insert(next);
                    if index == next {
                        parts.materials.push(name);
                    }
                    material = Some(index);
                }
                Some("mtllib") => parts.libraries.push(rest(&line, "mtllib").to_owned()),
                Some("p") => context.notes.add("points were left out"),
                Some("l") => context.notes.add("lines were left out"),
                Some("curv" | "curv2" | "surf") => {
                    context.notes.add("free-form curves and surfaces were left out");
                }
                Some("s") => parts.smoothing(words.next().unwrap_or_default()),
                // Groups are not told apart.
                Some("g") | None => {}
                Some(word) if word.starts_with('#') => {}
                Some(other) => {
                    parts.left_out.insert(name(other));
                }
            }
        }
        parts.check(context)?;
        parts.finish(&mut context.notes, context.options.vertex_color_space);
        Ok(parts)
    }

    /// The part with the faces of an object with a material, whose key these are.
    fn part(
        &mut self,
        key @ (object, material): (usize, Option<usize>),
        name: &str,
        numbers: &mut HashMap<(usize, Option<usize>), usize>,
        line: usize,
        context: &MeshContext<'_>,
    ) -> Result<&mut Part, SceneError> {
        let next = self.list.len();
        let number = *numbers.entry(key).or_insert(next);
        if number == MOST_PARTS {
            let (location, what) = (context.line(line), "meshes of a file");
            let (most, found) = (MOST_PARTS as u64, next as u64 + 1);
            return Err(SceneError::TooLarge { location, what, most, found });
        }
        if number == next {
            let name = name.to_owned();
            self.list.push(Part { object, name, material, ..Part::default() });
        }
        Ok(&mut self.list[number])
    }

    /// The faces that follow are of this smoothing group.
    fn smoothing(&mut self, group: &str) {
        let group = if group == "0" { "off" } else { group };
        if self.smoothing.len() < 2 && !self.smoothing.iter().any(|other| other == group) {
            self.smoothing.push(name(group));
        }
    }

    /// Cuts polygons, and brings numbers into their form.
    fn finish(&mut self, notes: &mut Notes, space: Option<ColorSpace>) {
        for part in &mut self.list {
            let [positions, coordinates, normals] = &mut part.faces;
            part.polygons.cut(&self.positions, &mut [positions, coordinates, normals], notes);
        }
        let named = self.list.iter().flat_map(|part| part.faces[0].iter().flatten().copied());
        self.near = Near::new(&mem::take(&mut self.positions), named, notes);
        let colors = mem::take(&mut self.colors);
        let space = space.unwrap_or(ColorSpace::Srgb);
        self.colors = colors::linear(colors, Written::Fractions, space, notes);
        let has_creases =
            self.smoothing.len() > 1 || self.smoothing.iter().any(|group| group == "off");
        if has_creases && self.list.iter().any(|part| part.missing[1] > 0) {
            notes.add("smoothing groups were left out: surfaces without normals are smooth");
        }
        if !self.left_out.is_empty() {
            let names: Vec<&str> = self.left_out.iter().map(String::as_str).collect();
            notes.add(left_out(["statement", "statements"], &names, ""));
        }
    }

    fn vertex(
        &mut self,
        words: SplitWhitespace<'_>,
        number: usize,
        context: &mut MeshContext<'_>,
    ) -> Result<(), SceneError> {
        let ([x, y, z, rest @ ..], count) =
            numbers::<f64, 7>(words, "a vertex", || context.line(number))?;
        check_count(count, 3, "a vertex", number, context)?;
        let mut position = [x, y, z];
        match count {
            4 => position = position.map(|x| x / rest[0]),
            5 => context.notes.add("of a vertex with five numbers two were left out"),
            7 if rest[3] != 1.0 => context.notes.add("opacities of vertices were left out"),
            _ => {}
        }
        if !position.iter().all(|&x| (x as f32).is_finite()) {
            let message = format!("a position is finite, and this is {position:?}");
            return Err(context.error_in(number, message));
        }
        // With the first colour the vertices before it turn out to have none.
        if count >= 6 {
            self.colors.resize(self.positions.len(), NO_COLOR);
            self.colors.push([rest[0], rest[1], rest[2]].map(|x| x as f32));
        } else if !self.colors.is_empty() {
            self.colors.push(NO_COLOR);
        }
        self.positions.push(position);
        Ok(())
    }

    /// Adds the rows at the corners of a face to `corners`.
    fn corners(
        &mut self,
        words: SplitWhitespace<'_>,
        corners: &mut Vec<[u32; 3]>,
        line: usize,
        context: &MeshContext<'_>,
    ) -> Result<(), SceneError> {
        let counts = [self.positions.len(), self.coordinates.len(), self.normals.len()];
        for word in words.take_while(|word| !word.starts_with('#')) {
            let refused = |message: String| context.error_in(line, message);
            let mut corner = [NO_ROW; 3];
            for (k, part) in word.split('/').enumerate() {
                let Some(slot) = corner.get_mut(k) else {
                    let rule = "a corner names a vertex, a texture coordinate and a normal at most";
                    return Err(refused(format!("{rule}, and this is {:?}", name(word))));
                };
                if part.is_empty() && k > 0 {
                    continue;
                }
                let (what, count) = (NAMED[k], counts[k]);
                let row = match part.parse::<i64>() {
                    Ok(number) if number < 0 => count as i64 + number,
                    // With 0 it is -1.
                    Ok(number) => number - 1,
                    Err(_) => {
                        let message =
                            format!("a corner has whole numbers, and this is {:?}", name(word));
                        return Err(refused(message));
                    }
                };
                *slot = match u32::try_from(row) {
                    Ok(row) if row != NO_ROW => row,
                    _ => {
                        let rule = format!("a {what} has a number from 1 on or back to -{count}");
                        return Err(refused(format!("{rule}, and this is {}", name(part))));
                    }
                };
                if *slot >= self.largest[k].0 {
                    self.largest[k] = (*slot, line);
                }
            }
            corners.push(corner);
        }
        Ok(())
    }

    /// Refuses corners that name what the file does not have.
    fn check(&self, context: &MeshContext<'_>) -> Result<(), SceneError> {
        let counts = [self.positions.len(), self.coordinates.len(), self.normals.len()];
        for (k, (row, line)) in self.largest.into_iter().enumerate() {
            // No line has named any where it is 0.
            if line > 0 && row as usize >= counts[k] {
                let (what, count) = (NAMED[k], counts[k]);
                let message = format!("a face names number {}", u64::from(row) + 1);
                let message = format!("the file has {count} of the kind {what:?}, and {message}");
                return Err(context.error_in(line, message));
            }
        }
        Ok(())
    }

    /// The parts of each surface. Objects that name the same vertices are one, since they would tear apart.
    pub(super) fn surfaces(&self, notes: &mut Notes) -> Vec<Vec<&Part>> {
        let objects = self.list.last().map_or(0, |part| part.object + 1);
        // The least of all objects that share vertices stands at the end of a chain.
        let mut leads: Vec<usize> = (0..objects).collect();
        let mut owners = vec![NO_ROW; self.near.positions.len()];
        for part in &self.list {
            for &vertex in part.faces[0].as_flattened() {
                let owner = &mut owners[vertex as usize];
                if *owner == NO_ROW {
                    *owner = part.object as u32;
                } else if *owner as usize != part.object {
                    join(&mut leads, *owner as usize, part.object);
                }
            }
        }
        let mut surfaces: Vec<Vec<&Part>> = Vec::new();
        let mut numbers = HashMap::new();
        for part in &self.list {
            let lead = lead_of(&mut leads, part.object);
            let number = *numbers.entry(lead).or_insert(surfaces.len());
            match surfaces.get_mut(number) {
                Some(parts) => parts.push(part),
                None => surfaces.push(vec![part]),
            }
        }
        for parts in &surfaces {
            let others = parts.iter().map(|part| part.object).collect::<HashSet<_>>().len() - 1;
            notes.count(
                "an object shares vertices with another one, and became one mesh with it",
                others,
            );
        }
        surfaces
    }

    /// A surface with its rows. `materials` has the numbers of the named materials.
    pub(super) fn raw<'a>(
        &'a self,
        parts: &[&'a Part],
        materials: &[Option<usize>],
        is_welded: bool,
        notes: &mut Notes,
    ) -> Raw<'a> {
        let mut submeshes: Vec<Submesh> = Vec::with_capacity(parts.len());
        let mut faces = [const { Vec::new() }; 4];
        let mut end = 0;
        for part in parts {
            let material = part.material.and_then(|material| materials[material]);
            let begin = end;
            end += part.faces[0].len();
            submeshes.push(Submesh { material, faces: begin..end });
            for (all, whole) in faces.iter_mut().zip(self.whole(part, notes)) {
                all.push(whole);
            }
        }
        let [positions, coordinates, normals, colors] = faces.map(|faces| joined(&faces, parts));
        Raw {
            name: parts.first().map_or(String::new(), |part| part.name.clone()),
            submeshes,
            is_welded,
            positions: Corners { rows: &self.near.positions, faces: positions.unwrap_or_default() },
            colors: colors.map(|faces| Corners { rows: &self.colors, faces }),
            coordinates: coordinates.map(|faces| Corners { rows: &self.coordinates, faces }),
            normals: normals.map(|faces| Corners { rows: &self.normals, faces }),
            tangents: None,
        }
    }

    /// The positions, coordinates, normals and colours at the corners of a part, of those that all of its
    /// corners have.
    fn whole<'a>(&self, part: &'a Part, notes: &mut Notes) -> [Option<&'a [[u32; 3]]>; 4] {
        let [positions, coordinates, normals] = part.faces.each_ref().map(Vec::as_slice);
        let corners = positions.len() * 3;
        let mut is_whole = |k: usize, what: &str| {
            let missing = part.missing[k];
            if missing > 0 && missing < corners {
                notes.add(format!("{what} of a mesh were left out: not all corners have one"));
            }
            missing == 0
        };
        let coordinates = is_whole(0, "coordinates").then_some(coordinates);
        let normals = is_whole(1, "normals").then_some(normals);
        let colored = positions.iter().flatten();
        let colored = colored.filter(|&&vertex| self.color(vertex).is_some()).count();
        if colored > 0 && colored < corners {
            notes.add("colours of a mesh were left out: not all vertices have one");
        }
        [Some(positions), coordinates, normals, (colored == corners).then_some(positions)]
    }

    fn color(&self, vertex: u32) -> Option<[f32; 3]> {
        self.colors.get(vertex as usize).copied().filter(|color| !color[0].is_nan())
    }
}

impl Part {
    /// Adds a face with these corners, as a fan of triangles.
    fn add(&mut self, corners: &[[u32; 3]]) {
        self.polygons.add(self.faces[0].len(), corners.len());
        for pair in corners[1..].windows(2) {
            let triangle = [corners[0], pair[0], pair[1]];
            for (k, faces) in self.faces.iter_mut().enumerate() {
                faces.push(triangle.map(|corner| corner[k]));
            }
            for (k, missing) in self.missing.iter_mut().enumerate() {
                *missing += triangle.iter().filter(|corner| corner[k + 1] == NO_ROW).count();
            }
        }
    }
}

/// The object that stands for all that share vertices with `object`.
fn lead_of(leads: &mut [usize], mut object: usize) -> usize {
    while leads[object] != object {
        // Halves the way for the next one.
        leads[object] = leads[leads[object]];
        object = leads[object];
    }
    object
}

fn join(leads: &mut [usize], a: usize, b: usize) {
    let [a, b] = [lead_of(leads, a), lead_of(leads, b)];
    leads[a.max(b)] = a.min(b);
}

/// The faces of all parts, [`NO_ROW`] where a part has none; nothing where none has.
fn joined<'a>(faces: &[Option<&'a [[u32; 3]]>], parts: &[&Part]) -> Option<Cow<'a, [[u32; 3]]>> {
    if let [only] = faces {
        return only.map(Cow::Borrowed);
    }
    faces.iter().any(Option::is_some).then(|| {
        let all = faces.iter().zip(parts).flat_map(|(faces, part)| {
            let none = if faces.is_none() { part.faces[0].len() } else { 0 };
            faces.unwrap_or_default().iter().copied().chain(repeat_n([NO_ROW; 3], none))
        });
        Cow::Owned(all.collect())
    })
}

fn check_count(
    count: usize,
    least: usize,
    what: &str,
    line: usize,
    context: &MeshContext<'_>,
) -> Result<(), SceneError> {
    match count < least {
        true => {
            let message = format!("{what} has {least} numbers or more, and this has {count}");
            Err(context.error_in(line, message))
        }
        false => Ok(()),
    }
}
