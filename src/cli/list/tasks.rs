//! `reactsim list tasks`: the training tasks.

use crate::models::TASKS;

/// Returns a row per task, recipe and input below a row of headings.
pub(super) fn rows() -> Vec<Vec<String>> {
    let row = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
    let mut rows = vec![row(["task", "option", "description"])];
    for task in TASKS {
        let simulators = task.simulators.join(", ");
        let readers = if simulators.is_empty() { "`curate --source diffusion`" } else { &simulators };
        rows.push(row([task.id, "", &format!("{}. Weights for {readers}.", task.title)]));
        for recipe in task.recipes {
            rows.push(row([task.id, &format!("--recipe {}", recipe.name), recipe.about]));
        }
        for input in task.inputs {
            let about = format!("{}{}", input.about, if input.required { "; required" } else { "" });
            rows.push(row([task.id, &format!("--input {}=FILE", input.name), &about]));
        }
        if task.needs_weights {
            rows.push(row([task.id, "--from FILE", "weights to continue from; required"]));
        }
    }
    rows
}
