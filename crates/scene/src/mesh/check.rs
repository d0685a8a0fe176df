//! Whether a model in memory can be written.

use crate::error::{Location, SceneError};
use crate::model::{Geometry, Indexed, NO_ROW, Submesh};

/// What stands in errors for the file, where a model comes from memory.
pub(super) fn location() -> Location {
    Location::new("the model to be written")
}

/// Refuses a geometry whose index buffers or numbers break a rule.
pub(super) fn check(geometry: &Geometry) -> Result<(), SceneError> {
    let Geometry {
        name, positions, faces, colors, coordinates, normals, tangents, submeshes, ..
    } = geometry;
    if faces.is_empty() {
        return Err(refused(name, "has a face or more, and this has none"));
    }
    rows(name, "positions", positions, faces)?;
    let mut end = 0;
    for Submesh { faces, .. } in submeshes {
        if faces.start != end || faces.is_empty() {
            let rule = "has submeshes with faces, one after another";
            return Err(refused(name, format!("{rule}, and {faces:?} follows {end}")));
        }
        end = faces.end;
    }
    if end != faces.len() {
        let message = format!("has submeshes of its {} faces, and these have {end}", faces.len());
        return Err(refused(name, message));
    }
    attribute(name, "colours", colors.as_ref(), submeshes)?;
    attribute(name, "coordinates", coordinates.as_ref(), submeshes)?;
    attribute(name, "normals", normals.as_ref(), submeshes)?;
    attribute(name, "tangents", tangents.as_ref(), submeshes)
}

/// Refuses a number beyond the last of `count` parts of a model.
pub(super) fn check_number(what: &str, number: usize, count: usize) -> Result<(), SceneError> {
    match number < count {
        true => Ok(()),
        false => {
            let message =
                format!("the model has {count} of the kind {what:?}, and number {number} is named");
            Err(SceneError::content(location(), message))
        }
    }
}

fn attribute<const N: usize>(
    name: &str,
    what: &str,
    indexed: Option<&Indexed<N>>,
    submeshes: &[Submesh],
) -> Result<(), SceneError> {
    let Some(indexed) = indexed else { return Ok(()) };
    let faces = submeshes.last().map_or(0, |submesh| submesh.faces.end);
    if indexed.faces.len() != faces {
        let found = indexed.faces.len();
        let rule = format!("has {what} for each of its {faces} faces, and these are for {found}");
        return Err(refused(name, rule));
    }
    for submesh in submeshes {
        let corners = &indexed.faces[submesh.faces.clone()];
        if corners.as_flattened().iter().any(|&row| row != NO_ROW) {
            rows(name, what, &indexed.rows, corners)?;
        }
    }
    Ok(())
}

fn rows<const N: usize>(
    name: &str,
    what: &str,
    rows: &[[f32; N]],
    faces: &[[u32; 3]],
) -> Result<(), SceneError> {
    let beyond = |face: &[u32; 3]| face.iter().any(|&row| row as usize >= rows.len());
    if let Some(face) = faces.iter().position(beyond) {
        let message = format!("face {face} names {:?}", faces[face]);
        return Err(refused(name, format!("has {} {what}, and {message}", rows.len())));
    }
    if let Some(k) = rows.iter().position(|row| !row.iter().all(|number| number.is_finite())) {
        return Err(refused(name, format!("has finite {what}, and number {k} is {:?}", rows[k])));
    }
    Ok(())
}

fn refused(name: &str, rule: impl std::fmt::Display) -> SceneError {
    SceneError::content(location(), format!("the mesh {name:?} {rule}"))
}
