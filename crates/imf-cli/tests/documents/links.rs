//! Links between the documents, and the book's table of contents.

use std::path::{Path, PathBuf};

use crate::markdown::Page;
use crate::{chapters, root};

/// Every page of the repository that people read.
fn pages() -> Vec<PathBuf> {
    let (mut found, mut waiting) = (vec![], vec![root().join("docs")]);
    while let Some(folder) = waiting.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                waiting.push(path);
            } else if path.extension().is_some_and(|ending| ending == "md") {
                found.push(path);
            }
        }
    }
    found.extend(
        ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(|name| root().join(name)),
    );
    found.sort();
    found
}

/// Why a link from a page leads nowhere.
fn fault(page: &Page, to: &str) -> Option<String> {
    if to.starts_with("https://") || to.starts_with("http://") {
        return None;
    }
    let (file, anchor) = to.split_once('#').map_or((to, None), |(file, anchor)| (file, Some(anchor)));
    let target = if file.is_empty() { page.path.clone() } else { page.path.parent().unwrap().join(file) };
    let Ok(target) = target.canonicalize() else { return Some("no such file".into()) };
    let book = root().join("docs");
    if page.path.starts_with(&book) && !target.starts_with(&book) {
        return Some("leads out of the book, where it is not a page: name the file instead".into());
    }
    let known = anchor.is_none_or(|anchor| Page::read(&target).anchors.iter().any(|name| name == anchor));
    (!known).then(|| "no such heading".into())
}

#[test]
fn every_link_leads_somewhere() {
    let mut faults = vec![];
    for page in pages().iter().map(|path| Page::read(path)) {
        for link in &page.links {
            if let Some(fault) = fault(&page, &link.to) {
                faults.push(format!("{}:{}: {}: {fault}", page.path.display(), link.line, link.to));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn links_that_lead_nowhere_are_found() {
    let from = |path: &str| Page::parse(&root().join(path), "");
    let page = from("docs/SUMMARY.md");
    assert_eq!(fault(&page, "BENCHMARKS.md#the-demo"), None);
    assert_eq!(fault(&page, "BENCHMARKS.md#no-such").as_deref(), Some("no such heading"));
    assert_eq!(fault(&page, "guide/none.md").as_deref(), Some("no such file"));
    assert!(fault(&page, "../README.md").unwrap().contains("out of the book"));
    assert_eq!(fault(&from("README.md"), "docs/SUMMARY.md"), None);
}

/// `mdbook` shows the first page as `index.html` of the whole book as well, with its links as they are: they hold there only
/// if it stands in the book's own folder.
#[test]
fn the_first_page_stands_where_the_book_begins() {
    assert_eq!(chapters()[0], "README.md");
}

#[test]
fn the_table_of_contents_has_every_page_once() {
    let book = root().join("docs");
    let mut listed: Vec<PathBuf> = chapters().iter().map(|page| book.join(page)).collect();
    listed.sort();
    let is_page = |path: &&PathBuf| path.starts_with(&book) && !path.ends_with(Path::new("SUMMARY.md"));
    let there: Vec<PathBuf> = pages().iter().filter(is_page).cloned().collect();
    assert_eq!(listed, there);
}
