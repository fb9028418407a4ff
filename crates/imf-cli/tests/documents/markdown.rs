//! What a page holds: links, headings, and code blocks with the comment before them.
//!
//! A comment in front of a block says how it is tested; nobody sees it:
//! `<!-- file: NAME -->` the block is a file that later commands read; `<!-- exit code: N -->` the commands end with it;
//! `<!-- not run: REASON -->` they are not run here. The first ```` ```text ```` block after commands is what they print.

use std::path::{Path, PathBuf};

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};

/// A link or a picture.
pub(crate) struct Link {
    pub(crate) to: String,
    pub(crate) line: usize,
}

/// A code block.
pub(crate) struct Block {
    pub(crate) language: String,
    pub(crate) text: String,
    pub(crate) line: usize,
    /// The comment right before it.
    pub(crate) comment: Option<String>,
}

/// A page as it was read.
pub(crate) struct Page {
    pub(crate) path: PathBuf,
    pub(crate) links: Vec<Link>,
    pub(crate) blocks: Vec<Block>,
    /// The names that links jump to.
    pub(crate) anchors: Vec<String>,
}

impl Page {
    pub(crate) fn read(path: &Path) -> Self {
        let text =
            std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self::parse(path, &text)
    }

    pub(crate) fn parse(path: &Path, text: &str) -> Self {
        let mut page = Self { path: path.to_owned(), links: vec![], blocks: vec![], anchors: vec![] };
        let (mut comment, mut heading, mut block) = (None, None::<String>, None::<Block>);
        for (event, range) in Parser::new_ext(text, Options::ENABLE_TABLES).into_offset_iter() {
            let line = text[..range.start].matches('\n').count() + 1;
            match event {
                Event::Html(html) => {
                    let inner = html.trim().strip_prefix("<!--").and_then(|rest| rest.strip_suffix("-->"));
                    comment = inner.map(|inner| inner.trim().to_owned()).or(comment);
                }
                Event::Start(Tag::CodeBlock(kind)) => {
                    let language = match kind {
                        CodeBlockKind::Fenced(language) => language.to_string(),
                        CodeBlockKind::Indented => String::new(),
                    };
                    block = Some(Block { language, text: String::new(), line, comment: comment.take() });
                }
                Event::End(TagEnd::CodeBlock) => page.blocks.extend(block.take()),
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => {
                    page.anchors.extend(heading.take().map(|text| anchor(&text)));
                }
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    page.links.push(Link { to: dest_url.to_string(), line });
                }
                Event::Start(Tag::Paragraph) => comment = None,
                Event::Text(piece) | Event::Code(piece) => {
                    if let Some(block) = &mut block {
                        block.text += &piece;
                    } else if let Some(heading) = &mut heading {
                        *heading += &piece;
                    }
                }
                _ => {}
            }
        }
        page
    }
}

/// A heading's name in links, as GitHub and mdBook make it.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

#[test]
fn a_page_gives_its_links_headings_and_blocks() {
    let text = "# One, `two`: three\n\nSee [this](that.md#a-b).\n\n<!-- exit code: 3 -->\n```sh\nfalse\n```\n\nText.\n\n\
                <!-- unused -->\nMore text.\n\n```text\nout\n```\n";
    let page = Page::parse(Path::new("page.md"), text);
    assert_eq!(page.anchors, ["one-two-three"]);
    assert_eq!((page.links[0].to.as_str(), page.links[0].line), ("that.md#a-b", 3));
    let blocks: Vec<_> =
        page.blocks.iter().map(|b| (b.language.as_str(), b.text.as_str(), b.comment.as_deref())).collect();
    assert_eq!(blocks, [("sh", "false\n", Some("exit code: 3")), ("text", "out\n", None)]);
    assert_eq!(page.blocks[0].line, 6);
}
