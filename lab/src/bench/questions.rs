//! All studies, one after the other.

use bokashi_fit::FitError;
use bokashi_report::{Cell, Section, Table, wrapped};
use serde_json::{Map, Value, json};

use crate::bench::effort::Effort;
use crate::bench::machine::Machine;
use crate::bench::mesh_file::MeshFile;
use crate::bench::setting::{Bench, Peer, method};
use crate::bench::studies::{self, Study};

/// The names of all studies.
pub const STUDIES: [&str; studies::ALL.len()] = {
    let (mut names, mut index) = ([""; studies::ALL.len()], 0);
    while index < names.len() {
        names[index] = studies::ALL[index].name;
        index += 1;
    }
    names
};

/// The studies of [`STUDIES`] that `only` names, or all where it names none. The study of meshes from files is
/// left out where there are none, but in a quick run, which makes one.
fn wanted(effort: Effort, only: &[String], has_meshes: bool) -> impl Iterator<Item = Study> {
    let has_meshes = effort == Effort::Quick || has_meshes;
    studies::ALL.into_iter().filter(move |study| {
        let is_named = only.is_empty() || only.iter().any(|one| one == study.name);
        is_named && (has_meshes || study.name != studies::MESHES)
    })
}

/// The files that the page of such a run has, itself among them.
pub fn files(effort: Effort, only: &[String], has_meshes: bool) -> Vec<String> {
    let tables = wanted(effort, only, has_meshes).flat_map(|study| study.tables);
    let tables = tables.map(|table| format!("bench-{table}.csv"));
    std::iter::once("bench.html".to_owned()).chain(tables).collect()
}

/// Does the studies of [`STUDIES`] that `only` names, or all where it names none; `on_study` is told
/// the name of each before it begins. The study of meshes from files takes `meshes`; without any it
/// is left out, but in a quick run, which makes one.
///
/// # Errors
/// Where a thread pool or a scene can't be made. What fails within a study is a result of it.
pub fn bench(
    effort: Effort,
    only: &[String],
    peers: Vec<Peer>,
    meshes: Vec<MeshFile>,
    on_study: &mut dyn FnMut(&str),
) -> Result<Vec<Section>, FitError> {
    let bench = Bench { peers, meshes, ..Bench::new(effort)? };
    let mut sections = Vec::new();
    for Study { name, run, .. } in wanted(effort, only, !bench.meshes.is_empty()) {
        on_study(name);
        sections.push(run(&bench)?);
    }
    Ok(sections)
}

/// All tables, as Markdown.
pub fn markdown(studies: &[Section], effort: Effort) -> String {
    let mut text = wrapped(&method(effort)) + "\n";
    for study in studies {
        text.push_str(&format!("\n{}", study.markdown()));
    }
    text
}

/// Everything found, as one JSON object: the machine, whether the run was quick, and per study its
/// tables as lists of objects.
pub fn json(studies: &[Section], effort: Effort) -> Value {
    let described = |study: &Section| {
        let tables: Map<String, Value> =
            study.tables().map(|table| (table.name.to_owned(), rows(table))).collect();
        let failures: Vec<_> = study.failures().collect();
        json!({ "study": study.id, "title": study.title, "failures": failures, "tables": tables })
    };
    json!({
        "machine": Machine::here(),
        "quick": effort == Effort::Quick,
        "studies": studies.iter().map(described).collect::<Vec<_>>(),
    })
}

/// The rows of a table as a list of objects.
fn rows(table: &Table) -> Value {
    fn value(cell: &Cell) -> Value {
        match cell {
            Cell::Text(words) => words.as_str().into(),
            Cell::Strong(cell) | Cell::Flagged(cell) => value(cell),
            Cell::Count(count) => (*count).into(),
            // Infinity and NaN become null.
            Cell::Number(number, _) | Cell::Time(number) => (*number).into(),
            Cell::Nothing => Value::Null,
        }
    }
    let object = |row: &Vec<Cell>| {
        let keys = table.columns.iter().map(|(_, key)| (*key).to_owned());
        Value::Object(keys.zip(row.iter().map(value)).collect::<Map<_, _>>())
    };
    table.rows.iter().map(object).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_all_digits_and_nothing_where_there_is_no_number() {
        let mut table = Table::new("speed", "Speed", &[("scene", "scene"), ("ms", "ms")]);
        table.push(vec![Cell::text("a"), Cell::number(0.012345)]);
        table.push(vec![Cell::Nothing, Cell::Number(f64::NAN, "*")]);
        table.push(vec![Cell::Count(7), Cell::Time(1.5).strong()]);
        let expected = json!([
            { "scene": "a", "ms": 0.012345 }, { "scene": null, "ms": null }, { "scene": 7, "ms": 1.5 }
        ]);
        assert_eq!(rows(&table), expected);
    }
}
