//! Mesh files.

use std::path::Path;

use bokashi_scene::{
    Geometry, MaterialFile, MaterialMap, MeshSummary, Model, Picture, SceneError, Submesh,
    read_model,
};
use serde_json::json;

use super::findings::{Findings, Section};
use super::folder::folder_of;
use crate::digits::{count, number, numbers};

/// Whether a note is about another file that the mesh file names and that is not used.
pub(super) fn is_problem(note: &str) -> bool {
    note.contains("is missing") || note.contains("can't be read")
}

/// What is in the mesh file `file`.
pub(super) fn inspect(file: &Path) -> Result<Findings, SceneError> {
    let (folder, name) = folder_of(file)?;
    let model = read_model(&folder, name)?;
    let mut findings = Findings::new("a mesh");
    let mut whole = Section::default();
    let faces: usize = model.geometries.iter().map(|geometry| geometry.faces.len()).sum();
    // JSON has them all under these names.
    whole.fact("geometries", model.geometries.len(), json!([]));
    whole.fact("materials", model.materials.len(), json!([]));
    whole.plain("images", model.images.len());
    whole.plain("faces", faces);
    findings.whole(whole);
    for (k, places) in model.places().iter().enumerate() {
        inspect_geometry(&mut findings, &model, k, places.len());
    }
    for (k, material) in model.materials.iter().enumerate() {
        findings.part("materials", inspect_material(&model, k, material));
    }
    for note in &model.notes {
        match is_problem(note) {
            true => findings.problem(note),
            false => findings.note(note),
        }
    }
    Ok(findings)
}

/// A number from 1 on, and the name if there is one.
fn title(what: &str, k: usize, name: &str) -> String {
    match name {
        "" => format!("{what} {}", k + 1),
        _ => format!("{what} {} {name:?}", k + 1),
    }
}

fn inspect_geometry(findings: &mut Findings, model: &Model, k: usize, places: usize) {
    let geometry = &model.geometries[k];
    let title = title("geometry", k, &geometry.name);
    let summary = MeshSummary::new(geometry);
    let mut section = Section::new(&title);
    section.silent("name", geometry.name.as_str());
    section.plain("vertices", geometry.positions.len());
    section.plain("faces", geometry.faces.len());
    if let Some([least, most]) = summary.extent {
        let text = |row: [f32; 3]| numbers(row.map(f64::from));
        section.fact("least", text(least), json!(least));
        section.fact("largest", text(most), json!(most));
    }
    let closed = match (summary.is_closed(), summary.boundary_edges) {
        (true, _) => "closed: each edge has two faces".to_owned(),
        (false, 0) => "not closed".to_owned(),
        (false, edges) => format!("open: {} of one face", count(edges, "edge")),
    };
    section.fact(
        "surface",
        closed,
        json!({
            "closed": summary.is_closed(),
            "boundary_edges": summary.boundary_edges,
            "crowded_edges": summary.crowded_edges,
            "turned_edges": summary.turned_edges,
            "degenerate_faces": summary.degenerate_faces,
            "repeated_faces": summary.repeated_faces,
        }),
    );
    if let Some(volume) = summary.volume {
        section.fact("volume", number(volume), volume);
    }
    let carried = [
        geometry.colors.as_ref().map(|attribute| ("colours", attribute.rows.len())),
        geometry
            .coordinates
            .as_ref()
            .map(|attribute| ("texture coordinates", attribute.rows.len())),
        geometry.normals.as_ref().map(|attribute| ("normals", attribute.rows.len())),
    ];
    for (what, rows) in carried.into_iter().flatten() {
        section.fact(what_label(what), format!("{rows} {what}"), rows);
    }
    section.fact("stands", count(places, "time"), places);
    add_materials(&mut section, model, geometry);
    findings.part("geometries", section);
    add_problems(findings, &title, model, geometry, &summary);
    if places == 0 {
        findings.problem(format!("{title}: no node of the file shows it"));
    }
}

/// Adds which faces have which material.
fn add_materials(section: &mut Section, model: &Model, geometry: &Geometry) {
    let named = |material: usize| {
        let name = model.materials.get(material).map_or("", |material| &material.name);
        title("number", material, name)
    };
    match geometry.submeshes.as_slice() {
        [Submesh { material: None, .. }] => (),
        [Submesh { material: Some(material), .. }] => {
            section.fact("material", named(*material), material + 1);
        }
        several => {
            let text = several.iter().map(|Submesh { material, faces }| {
                let name = material.map_or("none".to_owned(), named);
                format!("{name}: {}", count(faces.len(), "face"))
            });
            let value = several.iter().map(|Submesh { material, faces }| {
                json!({ "material": material.map(|material| material + 1), "faces": faces.len() })
            });
            let text = text.collect::<Vec<_>>().join("; ");
            section.fact("materials", text, value.collect::<serde_json::Value>());
        }
    }
}

/// Adds what is wrong with a geometry.
fn add_problems(
    findings: &mut Findings,
    title: &str,
    model: &Model,
    geometry: &Geometry,
    summary: &MeshSummary,
) {
    let &MeshSummary { crowded_edges, turned_edges, degenerate_faces, repeated_faces, .. } =
        summary;
    let rules = [
        (crowded_edges, "edge", "three faces or more: a surface has two there at most"),
        (turned_edges, "edge", "two faces that turn opposite sides outwards"),
        (degenerate_faces, "face", "no area"),
        (repeated_faces, "face", "the same vertices as another face"),
    ];
    for (wrong, what, rule) in rules.into_iter().filter(|(wrong, ..)| *wrong > 0) {
        let verb = if wrong == 1 { "has" } else { "have" };
        findings.problem(format!("{title}: {} {verb} {rule}", count(wrong, what)));
    }
    if summary.volume.is_some_and(|volume| volume < 0.0) {
        findings.problem(format!("{title}: the surface is inside out: its faces turn inwards"));
    }
    for Submesh { material, faces } in &geometry.submeshes {
        let material = material.and_then(|material| model.materials.get(material));
        let has_maps = material
            .is_some_and(|material| maps(material).iter().any(|(_, map)| map.image.is_some()));
        if has_maps
            && !geometry.coordinates.as_ref().is_some_and(|attribute| attribute.covers(faces))
        {
            let rule = "its material has an image, and it has no texture coordinates";
            findings.problem(format!("{title}: {rule}"));
        }
    }
}

/// The label of what corners carry, short enough for its column.
fn what_label(what: &str) -> &'static str {
    match what {
        "colours" => "colours",
        "normals" => "normals",
        _ => "coordinates",
    }
}

fn maps(material: &MaterialFile) -> [(&'static str, MaterialMap); 3] {
    [
        ("colour map", material.base_color_map),
        ("metal map", material.metallic_roughness_map),
        ("normal map", material.normal_map),
    ]
}

fn inspect_material(model: &Model, k: usize, material: &MaterialFile) -> Section {
    let mut section = Section::new(title("material", k, &material.name));
    section.silent("name", material.name.as_str());
    let color = material.base_color;
    section.fact("base colour", numbers(color.map(f64::from)), json!(color));
    section.fact("metallic", number(material.metallic.into()), f64::from(material.metallic));
    section.fact("roughness", number(material.roughness.into()), f64::from(material.roughness));
    for (label, map) in maps(material) {
        if let Some(picture) = map.image.and_then(|image| model.images.get(image)) {
            let Picture { width, height, channels, .. } = picture;
            let text = format!("{width} x {height} texels, {}", count(*channels, "channel"));
            section.fact(label, text, json!({ "size": [width, height], "channels": channels }));
        } else if map.is_missing {
            section.fact(label, "its image was left out", json!(null));
        }
    }
    section
}
