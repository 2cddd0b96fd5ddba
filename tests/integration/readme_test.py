"""The README's own commands, as a stranger would type them: every line that calls a program of the build is run."""
import pathlib
import re
import shlex
import subprocess

from programs import BIN, TIMEOUT_S, Case, main

ROOT = pathlib.Path(__file__).parents[2]


class Readme(Case):
    def test_its_commands_do_what_they_say(self):
        text = (ROOT / "README.md").read_text()
        lines = [line.split("#")[0].strip() for block in re.findall(r"```sh\n(.*?)```", text, re.S)
                 for line in block.splitlines() if line.startswith("build/release/bin/")]
        self.assertGreaterEqual(len(lines), 5)
        (self.folder / "build").mkdir()
        for line in lines:
            words = shlex.split(line)
            words[0] = str(BIN / pathlib.Path(words[0]).name)
            with self.subTest(command=line):
                done = subprocess.run(words, cwd=self.folder, capture_output=True, text=True, timeout=TIMEOUT_S)
                self.assertEqual(done.returncode, 0, done.stderr)
        for picture in ("plant.png", "walk.0054.png", "walk.0057.png"):
            self.assertGreater((self.folder / "build" / picture).stat().st_size, 20000)

    def test_files_it_names_are_there(self):
        text = (ROOT / "README.md").read_text()
        for name in re.findall(r"\]\(([^)]+)\)", text) + re.findall(r"`((?:tests|deploy)/[\w/.]+)`", text):
            self.assertTrue((ROOT / name).exists(), name)

    def test_help_has_examples(self):
        for program in ("quarry", "quarry-master", "quarry-worker", "quarry-preprocess", "quarry-scene"):
            with self.subTest(program=program):
                done = self.must(program, "--help")
                self.assertRegex(done.stdout, r"Example")


if __name__ == "__main__":
    main()
