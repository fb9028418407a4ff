//! Numbers out of range.

use crate::binary::Workdir;

#[test]
fn numbers_out_of_range_are_refused_beside_the_option_that_they_were_given_to() {
    let work = Workdir::new();
    for (line, name, value) in
        [("train --batch 1024,0", "--batch", "0"), ("access --points 0", "--points", "0")]
    {
        let refused = work.imf(line);
        assert_eq!(refused.code, Some(2), "`{line}`:\n{}", refused.stderr);
        let words = [format!("invalid value '{value}'"), format!("for '{name} <")];
        assert!(words.iter().all(|words| refused.stderr.contains(words)), "{line}:\n{}", refused.stderr);
    }
    assert!(work.entries().is_empty(), "a refusal left something behind");
}
