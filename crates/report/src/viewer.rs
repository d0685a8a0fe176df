//! Meshes that a reader turns: a block of a page, its data, and the script that draws them.
//!
//! The script is plain WebGL 2 and loads nothing, so a page works from a file. Where there is no WebGL,
//! or no script runs, a sentence says so. The data are JSON: arrays are base64 of little-endian
//! numbers, textures are addresses that hold their file. The same text feeds a page whose mesh
//! changes: there a script calls `bokashiViewer(figure)` and gives each state to its `show`.
//!
//! Faces are shaded flat by a light at the reader's eye. What is left out: opacity, normal maps and
//! reflections. It shows a shape and its colours, and is no renderer.

use std::fmt::Write as _;

use crate::error::ReportError;
use crate::markup::{base64, data_uri, escaped};

/// The script that turns every [`viewer`] block of a page into a view, and defines
/// `bokashiViewer` for other scripts. A [`Document`](crate::Document) carries it where a section
/// holds such a block.
pub const VIEWER_SCRIPT: &str = concat!(include_str!("drawing.js"), include_str!("viewer.js"));

/// How a block begins.
const FIGURE: &str = "<figure class=\"viewer\">";

/// A mesh to be shown.
#[derive(Debug, Clone, Copy)]
pub struct ViewerMesh<'a> {
    /// Positions in its own coordinates, which are right-handed; y is up where `transform` keeps it so.
    pub positions: &'a [[f32; 3]],
    /// Vertices of each face.
    pub faces: &'a [[u32; 3]],
    /// Colours of the vertices, encoded as sRGB from 0 to 1.
    pub colors: Option<&'a [[f32; 3]]>,
    /// Shown in the place of the colours.
    pub texture: Option<ViewerTexture<'a>>,
    /// From its own coordinates to those of the scene: a matrix, column by column.
    pub transform: [f32; 16],
}

/// A texture with its coordinates.
#[derive(Debug, Clone, Copy)]
pub struct ViewerTexture<'a> {
    /// Texture coordinates, v **down** from row 0 of the texture, as in glTF; beyond 0 and 1 the
    /// texture repeats.
    pub coordinates: &'a [[f32; 2]],
    /// For each face of the mesh the texture coordinates at its corners.
    pub faces: &'a [[u32; 3]],
    /// A PNG file of sRGB colours.
    pub png: &'a [u8],
}

/// Meshes of one scene as a block of a page, with a caption as text.
///
/// # Errors
/// As [`viewer_data`].
pub fn viewer(meshes: &[ViewerMesh<'_>], caption: &str) -> Result<String, ReportError> {
    let (data, caption) = (viewer_data(meshes)?, escaped(caption));
    Ok(format!(
        "{FIGURE}<figcaption>{caption}</figcaption><div><p>Here stands a mesh to turn and to zoom, \
         which needs a script to run: this page was opened without.</p></div>\
         <script type=\"application/json\">{data}</script></figure>"
    ))
}

/// Whether `html` holds a block of [`viewer`].
pub(crate) fn holds_viewer(html: &str) -> bool {
    html.contains(FIGURE)
}

/// Meshes of one scene as JSON for the script. Its text holds no `<` and is all ASCII.
///
/// # Errors
/// [`ReportError::Mesh`] where a mesh has another number of colours than of vertices, or its texture
/// another number of faces; where a face names a vertex or a coordinate that is not there.
pub fn viewer_data(meshes: &[ViewerMesh<'_>]) -> Result<String, ReportError> {
    let mut json = String::from("{\"meshes\":[");
    for (index, mesh) in meshes.iter().enumerate() {
        check(mesh)
            .map_err(|message| ReportError::Mesh(format!("mesh {index} of a view: {message}")))?;
        if index > 0 {
            json.push(',');
        }
        // Writing to a string cannot fail.
        let _ = write!(
            json,
            "{{\"place\":\"{}\",\"positions\":\"{}\",\"faces\":\"{}\"",
            floats(&mesh.transform),
            floats(mesh.positions.as_flattened()),
            indices(mesh.faces),
        );
        if let Some(colors) = mesh.colors {
            let _ = write!(json, ",\"colors\":\"{}\"", base64(&bytes(colors)));
        }
        if let Some(texture) = mesh.texture {
            let _ = write!(
                json,
                ",\"coordinates\":\"{}\",\"coordinateFaces\":\"{}\",\"texture\":\"{}\"",
                floats(texture.coordinates.as_flattened()),
                indices(texture.faces),
                data_uri(texture.png),
            );
        }
        json.push('}');
    }
    json.push_str("]}");
    Ok(json)
}

/// Whether the parts of a mesh fit each other: the rule that one breaks, and the value that breaks it.
fn check(mesh: &ViewerMesh<'_>) -> Result<(), String> {
    let (vertices, faces) = (mesh.positions.len(), mesh.faces.len());
    check_indices(mesh.faces, vertices, "vertices")?;
    if let Some(colors) = mesh.colors.filter(|colors| colors.len() != vertices) {
        let colors = colors.len();
        return Err(format!("each vertex has a colour, and {vertices} vertices have {colors}"));
    }
    let Some(texture) = mesh.texture else { return Ok(()) };
    if texture.faces.len() != faces {
        let others = texture.faces.len();
        return Err(format!("each face has texture coordinates, and {faces} faces have {others}"));
    }
    check_indices(texture.faces, texture.coordinates.len(), "texture coordinates")
}

fn check_indices(faces: &[[u32; 3]], count: usize, what: &str) -> Result<(), String> {
    let mut all = faces.as_flattened().iter();
    match all.find(|&&index| index as usize >= count) {
        Some(index) => Err(format!("a face names {what} that are there, {count}, got {index}")),
        None => Ok(()),
    }
}

fn floats(numbers: &[f32]) -> String {
    base64(&numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<_>>())
}

fn indices(faces: &[[u32; 3]]) -> String {
    let numbers = faces.as_flattened().iter();
    base64(&numbers.flat_map(|number| number.to_le_bytes()).collect::<Vec<_>>())
}

/// Colours from 0 to 1 in 256 steps; NaN is 0.
fn bytes(colors: &[[f32; 3]]) -> Vec<u8> {
    let channels = colors.as_flattened().iter();
    channels.map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8).collect()
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;

    use super::*;
    use crate::document::{About, Document};
    use crate::section::Section;

    const UNIT: [f32; 16] =
        [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    const POSITIONS: [[f32; 3]; 3] = [[0.0, 0.5, -1.25], [f32::MAX, 1e-40, 3.0], [1.0, 2.0, 3.0]];
    const FACES: [[u32; 3]; 2] = [[0, 1, 2], [2, 1, 0]];

    fn mesh() -> ViewerMesh<'static> {
        let (positions, faces) = (&POSITIONS, &FACES);
        ViewerMesh { positions, faces, colors: None, texture: None, transform: UNIT }
    }

    fn texture() -> ViewerTexture<'static> {
        let coordinates = &[[0.0, 0.25], [1.0, 0.75]];
        ViewerTexture { coordinates, faces: &[[0, 1, 0], [1, 0, 1]], png: b"a PNG file" }
    }

    /// The string under `key` of the first mesh that has it.
    fn entry<'a>(json: &'a str, key: &str) -> &'a str {
        let (_, rest) = json.split_once(&format!("\"{key}\":\"")).expect("the key");
        rest.split_once('"').expect("the end of a string").0
    }

    fn decoded(json: &str, key: &str) -> Vec<u8> {
        STANDARD.decode(entry(json, key)).expect("base64")
    }

    #[test]
    fn numbers_come_back_from_the_data_bit_by_bit() {
        let colors = &[[0.0, 0.5, 1.0], [f32::NAN, -1.0, 2.0], [0.2, 0.4, 0.6]];
        let full = ViewerMesh { colors: Some(colors), texture: Some(texture()), ..mesh() };
        let json = viewer_data(&[full]).expect("the parts fit");
        let words = |key: &str| -> Vec<[u8; 4]> {
            let bytes = decoded(&json, key);
            bytes.chunks_exact(4).map(|word| word.try_into().expect("four bytes")).collect()
        };
        let floats =
            |key| words(key).into_iter().map(f32::from_le_bytes).map(f32::to_bits).collect();
        let indices = |key| words(key).into_iter().map(u32::from_le_bytes).collect();
        let bits = |numbers: &[f32]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let positions: Vec<u32> = floats("positions");
        assert_eq!(positions, bits(POSITIONS.as_flattened()));
        let place: Vec<u32> = floats("place");
        assert_eq!(place, bits(&UNIT));
        let coordinates: Vec<u32> = floats("coordinates");
        assert_eq!(coordinates, bits(&[0.0, 0.25, 1.0, 0.75]));
        let faces: Vec<u32> = indices("faces");
        assert_eq!(faces, FACES.as_flattened());
        let faces: Vec<u32> = indices("coordinateFaces");
        assert_eq!(faces, [0, 1, 0, 1, 0, 1]);
        assert_eq!(decoded(&json, "colors"), [0, 128, 255, 0, 0, 255, 51, 102, 153]);
        let png = entry(&json, "texture").strip_prefix("data:image/png;base64,").expect("a PNG");
        assert_eq!(STANDARD.decode(png).expect("base64"), b"a PNG file");
    }

    #[test]
    fn a_block_holds_its_caption_as_text_a_sentence_and_all_meshes() {
        let html = viewer(&[mesh(), mesh()], "a <b> & \"c\"").expect("the parts fit");
        assert!(html.starts_with(FIGURE) && html.ends_with("</figure>"));
        assert!(html.contains("<figcaption>a &lt;b&gt; &amp; &quot;c&quot;</figcaption>"));
        assert!(html.contains("needs a script to run"));
        assert_eq!(html.matches("\"positions\"").count(), 2);
        assert!(!html.contains("\"colors\"") && !html.contains("\"texture\""));
        let none = viewer(&[], "nothing").expect("no mesh is no error");
        assert!(none.contains("{\"meshes\":[]}"));
    }

    #[test]
    fn a_page_carries_the_script_once_where_it_holds_a_viewer_and_else_never() {
        let block = viewer(&[mesh()], "a mesh").expect("the parts fit");
        let page = |body: &str| {
            let section = |id| {
                let mut section = Section::new(id, "A section", "");
                section.push_html(body);
                section
            };
            let (heading, introduction) = ("heading".to_owned(), String::new());
            let (sections, files) = (vec![section("one"), section("two")], Vec::new());
            let about = About::default();
            let document =
                Document { name: "index", heading, introduction, sections, files, about };
            document.render().expect("no figure").html
        };
        assert_eq!(page(&block).matches(VIEWER_SCRIPT).count(), 1);
        assert!(!page("<p>no mesh</p>").contains("<script"));
    }

    #[test]
    fn the_script_loads_nothing_and_ends_no_element_of_a_page() {
        for part in ["</script", "<!--", "fetch(", "import ", "XMLHttpRequest", "http:", "https:"] {
            assert!(!VIEWER_SCRIPT.contains(part), "{part}");
        }
    }

    #[test]
    fn parts_that_do_not_fit_each_other_are_named() {
        let said = |mesh| viewer(&[self::mesh(), mesh], "").unwrap_err().to_string();
        let colors = Some(&[[0.0; 3]; 2][..]);
        assert_eq!(
            said(ViewerMesh { colors, ..mesh() }),
            "mesh 1 of a view: each vertex has a colour, and 3 vertices have 2"
        );
        assert_eq!(
            said(ViewerMesh { faces: &[[0, 1, 3]], ..mesh() }),
            "mesh 1 of a view: a face names vertices that are there, 3, got 3"
        );
        let one = ViewerTexture { faces: &[[0, 1, 0]], ..texture() };
        assert_eq!(
            said(ViewerMesh { texture: Some(one), ..mesh() }),
            "mesh 1 of a view: each face has texture coordinates, and 2 faces have 1"
        );
        let beyond = ViewerTexture { faces: &[[0, 1, 0], [0, 0, u32::MAX]], ..texture() };
        assert_eq!(
            said(ViewerMesh { texture: Some(beyond), ..mesh() }),
            "mesh 1 of a view: a face names texture coordinates that are there, 2, got 4294967295"
        );
    }
}
