//! Bundles JavaScript modules into one script: a page opened from a disk cannot import modules.

use super::assets::Asset;

/// Joins modules, each given after its imports. A module becomes a function that is called immediately;
/// a variable named after it holds its exports. Supported: `import { a, b as c } from "./name.js";`,
/// `import * as name from "./name.js";` (each on one line), and `export` before `function`,
/// `async function`, `class` and `const`.
pub fn bundle<'a>(modules: impl IntoIterator<Item = &'a Asset>) -> String {
    let mut out = String::from("\"use strict\";\n");
    for module in modules {
        let mut names = Vec::new();
        let mut body = String::with_capacity(module.text.len());
        for line in module.text.lines() {
            if let Some(rest) = line.strip_prefix("import ") {
                body.push_str(&imported(rest));
            } else if let Some(rest) = line.strip_prefix("export ") {
                names.extend(exported(rest));
                body.push_str(rest);
            } else {
                body.push_str(line);
            }
            body.push('\n');
        }
        let own = variable(module.name);
        out.push_str(&format!("const {own} = (() => {{\n{body}return {{ {} }};\n}})();\n", names.join(", ")));
    }
    out
}

/// Returns the variable that holds the exports of a module.
fn variable(file: &str) -> String {
    let stem = file.trim_start_matches("./").trim_end_matches(".js");
    format!("${}", stem.replace(|c: char| !c.is_alphanumeric(), "_"))
}

/// Converts `{ a, b as c } from "./name.js";` to a declaration.
fn imported(rest: &str) -> String {
    let (what, from) = rest.split_once(" from ").unwrap_or((rest, ""));
    let own = variable(from.trim_end_matches(';').trim_matches('"'));
    match what.trim().strip_prefix("* as ") {
        Some(name) => format!("const {name} = {own};"),
        None => format!("const {} = {own};", what.replace(" as ", ": ")),
    }
}

/// Returns the name that a line declares.
fn exported(rest: &str) -> Option<&str> {
    let rest = rest.strip_prefix("async ").unwrap_or(rest);
    let rest = ["function* ", "function ", "class ", "const "].iter().find_map(|k| rest.strip_prefix(k))?;
    rest.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == '$')).next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_are_isolated() {
        let module = |name, text| Asset { name, text };
        let modules = [
            module("a.js", "const secret = 1;\nexport const open = 2;\nexport async function go() {}\n"),
            module("b-c.js", "import { open as o, go } from \"./a.js\";\nimport * as a from \"./a.js\";\n"),
        ];
        assert_eq!(
            bundle(&modules),
            "\"use strict\";\n\
             const $a = (() => {\nconst secret = 1;\nconst open = 2;\nasync function go() {}\n\
             return { open, go };\n})();\n\
             const $b_c = (() => {\nconst { open: o, go } = $a;\nconst a = $a;\nreturn {  };\n})();\n"
        );
    }
}
