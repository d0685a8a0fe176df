//! What a scene does not need changes no bit, and the tape's report names it.

use bokashi_lab::bench::{Effort, Row, elision};

/// The rows, and what their reports name as left out.
const ROWS: [(&str, &[&str]); 17] = [
    (
        "frozen positions",
        &[
            "rasterize: recording",
            "interpolate: gradient of input 1",
            "antialias: gradient of input 0",
        ],
    ),
    ("frozen colours", &["interpolate: gradient of input 0"]),
    ("frozen sigma", &["gaussian_blur: gradient of input 1"]),
    ("sigma 0", &["gaussian_blur: sigma is 0"]),
    ("antialias without discontinuities", &["antialias: no discontinuities"]),
    ("empty background", &["image: gradient of input 1"]),
    ("no face near the near plane", &["rasterize: whole rows"]),
    ("depth not asked for", &["depth: not recorded"]),
    (
        "frozen positions of a lit surface",
        &["vertex_normals: recording", "shade: gradient of input 0"],
    ),
    ("frozen light", &["shade: gradient of input 6"]),
    (
        "texture without mipmaps",
        &["mipmaps: not recorded", "sample_texture: detail: there is a single level"],
    ),
    (
        "differentials not asked for",
        &["differentials: not recorded", "interpolate_differentials: not recorded"],
    ),
    ("frozen texels", &["mipmaps: recording", "sample_texture: gradient of input 3"]),
    (
        "fixed coordinates",
        &[
            "interpolate: recording",
            "interpolate_differentials: recording",
            "sample_texture: gradient of input 0",
            "sample_texture: gradient of input 1",
        ],
    ),
    ("a single layer", &["composite_layers: not recorded"]),
    ("hidden layers", &["composite_layers: not recorded"]),
    (
        "inference without gradients",
        &[
            "project: recording",
            "rasterize: recording",
            "interpolate: recording",
            "image: recording",
            "antialias: recording",
            "gaussian_blur: recording",
            "squared_error: recording",
        ],
    ),
];

fn rows() -> Vec<Row> {
    elision(Effort::Quick).expect("steps that nothing refuses")
}

#[test]
fn results_are_those_of_everything_computed_to_the_bit() {
    let rows = rows();
    assert_eq!(rows.len(), ROWS.len());
    for row in &rows {
        assert!(row.bitwise_equal(), "{row:?}");
        // A picture and a loss, and whatever gradients both steps have.
        let compared: Vec<&str> = row.results.iter().map(|(name, _)| *name).collect();
        let gradients = match row.row {
            "sigma 0" => 3,
            "antialias without discontinuities" | "inference without gradients" => 0,
            "fixed coordinates" => 1,
            "texture without mipmaps" | "differentials not asked for" => 3,
            _ => 2,
        };
        assert_eq!(compared[..2], ["picture", "loss"], "{}", row.row);
        assert_eq!(compared.len(), 2 + gradients, "{}: {compared:?}", row.row);
    }
}

#[test]
fn the_report_names_what_was_left_out() {
    let rows = rows();
    let missing = ROWS.iter().zip(&rows).flat_map(|((name, operations), row)| {
        assert_eq!(*name, row.row);
        let named = |operation: &&&str| row.left_out.iter().any(|one| one.starts_with(**operation));
        let missing: Vec<_> = operations.iter().filter(|one| !named(one)).collect();
        missing.into_iter().map(move |operation| format!("{name}: {operation}")).collect::<Vec<_>>()
    });
    let missing: Vec<String> = missing.collect();
    assert!(missing.is_empty(), "not named: {missing:?}");
}
