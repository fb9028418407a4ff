//! The table of the three parts: `single` and `multi` against the exact field, and baselines in the same rows.

use anyhow::{Context as _, Result};
use imf_core::parts::ReferencePart;

use super::baselines::{self, Method};
use super::published::PAPER;
use super::table::{FieldCost, Kind, PaperComparison, Row, Table};
use super::{Bench, Training, figures, part_label};
use crate::cells::Cell;
use crate::recipe::{EvaluationSets, Recipe};

/// The recipes of the table.
const RECIPES: [&str; 2] = ["single", "multi"];

impl Bench<'_> {
    /// A part's training by a recipe.
    pub(super) fn trained(&self, part: ReferencePart, recipe: &str) -> Result<Training> {
        let part = part.name();
        self.run(&format!("{recipe}-{part}"), &self.protocol.recipe(recipe, Some(part))?)
    }

    /// What stands beside the paper's network, for a part.
    pub(super) fn baselines(&self, part: ReferencePart) -> Result<Option<Cell<Vec<Method>>>> {
        let recipe = self.protocol.recipe("single", Some(part.name()))?.recipe()?;
        let n = trained_grid(&recipe)?;
        let key = (&recipe.scene, &recipe.evaluation, n, self.protocol.distillation());
        let name = format!("baselines-{}", part.name());
        self.cell(&name, &key, || baselines::measure(self, &recipe, n))
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
    let mut pictures = Vec::new();
    for &part in &bench.parts {
        let name = part_label(part);
        let mut runs = Vec::new();
        for recipe in RECIPES {
            let evaluation_sets = EvaluationSets::of(&bench.protocol.recipe(recipe, None)?.recipe()?)?;
            let training = bench.trained(part, recipe)?;
            let papers = PAPER.parts[recipe].get(part.name());
            let paper = |index: usize| papers.and_then(|papers| papers.get(index).copied());
            // The paper's time is of `single`.
            let seconds = PAPER.seconds.get(part.name()).filter(|_| recipe == "single").map(|own| own[0]);
            table.add_training(&[&name, recipe], (&training, None), &evaluation_sets, paper, seconds)?;
            if let Training::Finished(run) = training {
                runs.push((recipe, run));
            }
        }
        let evaluation_sets = EvaluationSets::of(&single)?;
        if !runs.is_empty() {
            match figures::fields(bench, part, &evaluation_sets, &runs)? {
                Some(figure) => pictures.push(figure),
                None => {
                    table.notes.push(format!("{name}: not drawn yet, for which its networks must be here."));
                }
            }
        }
    }
    table.figures = figures::scenes(bench)?.into_iter().chain(pictures).collect();
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
        let Some(measured) = bench.baselines(part)? else {
            table.notes.push(format!("{name}: not made yet."));
            continue;
        };
        for method in measured.value {
            for answer in &method.answers {
                let labels = vec![name.clone(), method.name.clone(), answer.name.clone()];
                table.rows.push(Row::errors(labels, None, Some(&answer.errors)));
            }
            table.made.push(FieldCost {
                labels: vec![name.clone(), method.name],
                bytes: method.bytes,
                seconds: method.made,
                sections: Some(method.sections),
                on: measured.made_on.clone(),
                ..FieldCost::default()
            });
        }
    }
    Ok(table)
}

/// Which field meets how much of the paper's rows, and what it takes: for each part the paper's network by each recipe, and all
/// others.
pub(super) fn families(table: &Table, others: &Table) -> Table {
    let labels = ["part", "field", "meets of the paper's single", "of its multi"];
    let values = [("file", Kind::Bytes), ("made in", Kind::Seconds)];
    let mut families =
        Table::new("3d-families", "What meets a row of the paper, by file and time", &labels, &values);
    families.judged = false;
    families.notes.push(
        "Of the eight cells that the paper has of a part by a recipe, how many a field meets. Its network, which took 10 to 16 hours on a GPU, is \
         `siren5` here. Sections that are kept answer their own directions exactly, whatever they err between them. The networks' minima are of \
         drawn voxels where a standard error is given, the other fields' of all."
            .into(),
    );
    for made in table.made.iter().chain(&others.made) {
        let of_field = |row: &&Row| row.labels.starts_with(&made.labels);
        let rows: Vec<&Row> = table.rows.iter().chain(&others.rows).filter(of_field).collect();
        let own = RECIPES.contains(&made.labels[1].as_str());
        let name = if own { format!("siren5, {}", made.labels[1]) } else { made.labels[1].clone() };
        let met = RECIPES.map(|recipe| {
            let papers = |row: &&Row| row.labels[..2] == [made.labels[0].as_str(), recipe];
            cells_met(&rows, table.rows.iter().filter(papers))
        });
        families.rows.push(Row {
            labels: [made.labels[0].clone(), name].into_iter().chain(met).collect(),
            values: vec![
                PaperComparison::new(own.then_some(PAPER.network_bytes), Some(made.bytes as f64)),
                PaperComparison::new(made.paper_seconds, Some(made.seconds)),
            ],
        });
    }
    // Parts together, in the order of the paper.
    let order = |row: &Row| table.made.iter().position(|made| made.labels[0] == row.labels[0]);
    families.rows.sort_by_key(order);
    families
}

/// `7 of 8`: of the cells that the paper has in its rows, those which a field's rows of the same comparisons are at or below.
fn cells_met<'a>(rows: &[&Row], papers: impl Iterator<Item = &'a Row>) -> String {
    let (mut all, mut met) = (0, 0);
    for paper in papers {
        // Which sections were learnt from differs from field to field.
        let asked = |row: &Row| {
            row.labels[2].split_once("°), ").map_or(row.labels[2].clone(), |(asked, _)| asked.into())
        };
        let own = rows.iter().find(|row| asked(row) == asked(paper));
        for (index, limit) in paper.values.iter().enumerate().filter_map(|(i, value)| Some((i, value.paper?)))
        {
            let ours = own.and_then(|row| row.values[index].ours);
            all += 1;
            met += usize::from(ours.is_some_and(|ours| ours <= limit));
        }
    }
    if all == 0 { "–".into() } else { format!("{met} of {all}") }
}

#[cfg(test)]
mod tests {
    use super::super::table::Standing;
    use super::*;

    #[test]
    fn each_field_is_held_against_both_rows_of_its_part() {
        let mut table = Table::of_errors("3d", "t", &["part", "field", "compared"]);
        let row = |[part, field, asked]: [&str; 3], papers: Option<f64>, mse: f64| Row {
            labels: [part, field, asked].map(String::from).into(),
            values: vec![
                PaperComparison::new(papers, Some(mse)),
                PaperComparison::new(papers.map(|_| 0.1), Some(0.05)),
            ],
        };
        table.rows = vec![
            row(["teapot", "single", "section (1°, 2°), in-sample"], Some(1e-6), 4e-6),
            row(["teapot", "single", "64 random sections"], None, 3e-6),
            row(["teapot", "multi", "section (1°, 2°), in-sample of stage coarse"], Some(5e-6), 9e-7),
            row(["gear", "single", "section (1°, 2°), in-sample"], Some(1e-6), 1e-6),
        ];
        let mut others = Table::of_errors("3d-others", "t", &["part", "field", "compared"]);
        others.rows = ["teapot", "gear"]
            .map(|part| {
                row(
                    [part, "linear", "section (1°, 2°), out-of-sample"],
                    None,
                    if part == "gear" { 0.0 } else { 2e-6 },
                )
            })
            .into();
        let made = |part: &str, field: &str| FieldCost {
            labels: [part, field].map(String::from).into(),
            bytes: 100,
            ..FieldCost::default()
        };
        table.made = vec![made("teapot", "single"), made("teapot", "multi"), made("gear", "single")];
        others.made = vec![made("teapot", "linear"), made("gear", "linear")];
        let families = families(&table, &others);
        let labels: Vec<String> = families.rows.iter().map(|row| row.labels.join("; ")).collect();
        assert_eq!(
            labels,
            [
                "teapot; siren5, single; 1 of 2; 2 of 2",
                "teapot; siren5, multi; 2 of 2; 2 of 2",
                "teapot; linear; 1 of 2; 2 of 2",
                "gear; siren5, single; 2 of 2; –",
                "gear; linear; 2 of 2; –"
            ]
        );
        assert_eq!(families.standing(), Standing::default(), "cells are counted once");
        assert_eq!(families.rows[2].values[0].paper, None);
    }
}
