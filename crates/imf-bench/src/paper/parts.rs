//! The table of the three parts: `single` and `multi` against the exact field, and baselines in the same rows.

use anyhow::{Context as _, Result};
use imf_core::parts::ReferencePart;

use super::baselines::{self, Method};
use super::published::PAPER;
use super::table::{Compared, Kind, Row, Table};
use super::{Bench, Training, figures, part_label};
use crate::recipe::{Questions, RANDOM, Recipe};

/// The recipes of the table.
const RECIPES: [&str; 2] = ["single", "multi"];
/// The families of ours, as their rows begin.
const OURS: [&str; 2] = ["harmonic", "factored"];

impl Bench<'_> {
    /// A part's training by a recipe.
    pub(super) fn trained(&self, part: ReferencePart, recipe: &str) -> Result<Training> {
        let part = part.name();
        self.run(&format!("{recipe}-{part}"), &self.protocol.recipe(recipe, Some(part))?)
    }

    /// What stands beside the paper's network, for a part.
    pub(super) fn baselines(&self, part: ReferencePart) -> Result<Vec<Method>> {
        let recipe = self.protocol.recipe("single", Some(part.name()))?.recipe()?;
        let n = trained_grid(&recipe)?;
        let key = (&recipe.scene, &recipe.evaluation, n, self.protocol.distillation());
        let name = format!("baselines-{}", part.name());
        self.cells.get(&name, &key, || baselines::measure(self, &recipe, n))
    }
}

/// N of the `grid:N` that `single` learns from.
fn trained_grid(single: &Recipe) -> Result<usize> {
    let spec = single.stages.first().map(|stage| stage.orientations.as_str());
    let n = spec.and_then(|spec| spec.strip_prefix("grid:")?.parse().ok());
    n.context("single must learn from a grid of orientations to be compared with interpolation")
}

pub(super) fn table(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("3d", "Three parts in space", &["part", "recipe", "compared"]);
    let single = bench.protocol.recipe("single", None)?.recipe()?;
    table.notes.push(
        "`single` and `multi` are the paper's network (`siren5`) and recipes. Random sections are ours: at orientations of no grid."
            .into(),
    );
    for &part in &bench.parts {
        let name = part_label(part);
        let mut runs = Vec::new();
        for recipe in RECIPES {
            let questions = Questions::of(&bench.protocol.recipe(recipe, None)?.recipe()?.evaluation)?;
            let training = bench.trained(part, recipe)?;
            let papers = PAPER.parts[recipe].get(part.name());
            let paper = |index: usize| papers.and_then(|papers| papers.get(index).copied());
            table.add_training(&[&name, recipe], (&training, None), &questions, paper)?;
            runs.extend(training.ok().map(|run| (recipe, run)));
        }
        let questions = Questions::of(&single.evaluation)?;
        if !runs.is_empty() {
            table.figures.push(figures::fields(bench, part, &questions, &runs)?);
        }
    }
    table.figures.insert(0, figures::scenes(bench)?);
    Ok(table)
}

/// What is made from as many exact sections, in the same rows.
pub(super) fn others(bench: &Bench<'_>) -> Result<Table> {
    let mut table =
        Table::of_errors("3d-others", "Other fields of the same parts", &["part", "field", "compared"]);
    let sections = trained_grid(&bench.protocol.recipe("single", None)?.recipe()?)?.pow(2);
    table.notes.push(format!(
        "From as many exact sections as `single` ({sections}): the nearest one, linear interpolation in θ and φ, the harmonic \
         field (its fit reads each section twice), and the factored field that is distilled from it."
    ));
    for &part in &bench.parts {
        let name = part_label(part);
        for method in bench.baselines(part)? {
            for answer in &method.answers {
                let labels = vec![name.clone(), method.name.clone(), answer.name.clone()];
                table.rows.push(Row::errors(labels, None, Some(&answer.errors)));
            }
            table.notes.push(format!(
                "{name}, {}: {}, made in {}; 225 sections in {}.",
                method.name,
                Kind::Bytes.show(method.bytes as f64),
                Kind::Seconds.show(method.made),
                Kind::Seconds.show(method.sections)
            ));
        }
    }
    Ok(table)
}

/// The paper's network and, for each part, that of our families which errs least at random orientations, each in its own
/// columns beside the paper's MSE.
pub(super) fn side_by_side(table: &Table, others: &Table) -> Table {
    let values = [("siren5", Kind::Error), ("best family", Kind::Error)];
    let labels = ["part", "recipe", "compared", "best family is"];
    let mut beside =
        Table::new("3d-best", "The paper's network and our best family, side by side", &labels, &values);
    beside.notes.push(
        "MSE. The paper's network (`siren5`) by each recipe, and of our families the one that errs least at random \
         orientations of the part; both beside the paper's value, which is its network's."
            .into(),
    );
    let ours = |row: &&Row| OURS.iter().any(|name| row.labels[1].starts_with(name));
    let mse = |row: &Row| row.values[0].ours.unwrap_or(f64::INFINITY);
    for row in &table.rows {
        let of_part = || others.rows.iter().filter(|other| other.labels[0] == row.labels[0]).filter(ours);
        let random = of_part().filter(|other| other.labels[2].ends_with(RANDOM));
        let Some(best) = random.min_by(|a, b| mse(a).total_cmp(&mse(b))) else { continue };
        let answer =
            of_part().find(|other| other.labels[1..] == [best.labels[1].clone(), row.labels[2].clone()]);
        let answer = answer.and_then(|row| row.values[0].ours);
        beside.rows.push(Row {
            labels: row.labels.iter().chain([&best.labels[1]]).cloned().collect(),
            values: vec![row.values[0].clone(), Compared::new(row.values[0].paper, answer)],
        });
    }
    beside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_family_is_the_one_with_the_least_error_at_random_orientations() {
        let mut table = Table::of_errors("3d", "t", &["part", "field", "compared"]);
        let row = |field: &str, asked: &str, paper: Option<f64>, ours: f64| Row {
            labels: ["teapot", field, asked].map(String::from).into(),
            values: vec![Compared::new(paper, Some(ours)), Compared::new(None, Some(9.0))],
        };
        table.rows =
            vec![row("single", "IMF", Some(1e-6), 4e-6), row("single", "64 random sections", None, 3e-6)];
        let mut others = Table::of_errors("3d-others", "t", &["part", "field", "compared"]);
        others.rows = vec![
            row("linear", "IMF", None, 1e-9),
            row("linear", "64 random sections", None, 1e-9),
            row("harmonic, degree 6", "IMF", None, 5e-7),
            row("harmonic, degree 6", "64 random sections", None, 2e-7),
            row("factored, 3×256", "IMF", None, 1e-8),
            row("factored, 3×256", "64 random sections", None, 3e-7),
        ];
        let beside = side_by_side(&table, &others);
        let found: Vec<_> = beside.rows.iter().map(|row| (row.values[0].ours, row.values[1].ours)).collect();
        assert_eq!(found, [(Some(4e-6), Some(5e-7)), (Some(3e-6), Some(2e-7))]);
        assert!(beside.rows.iter().all(|row| row.labels[3] == "harmonic, degree 6"));
        assert_eq!(beside.rows[0].values[1].paper, Some(1e-6));
        let (head, cells) = beside.cells();
        assert!(
            head.contains(&"siren5 paper".into()) && head.contains(&"best family ours".into()),
            "{head:?}"
        );
        assert_eq!(cells[0].last().unwrap(), "**falls short**: siren5");
    }
}
