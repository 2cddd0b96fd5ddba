"""The manifests for Kubernetes, against the models of its own client (python3-kubernetes): every field is known, and none is lost."""
import pathlib
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import Case, main

MANIFEST = pathlib.Path(__file__).parents[3] / "deploy/kubernetes/quarry.yaml"
# Reads each object as its model and writes it again: a field that the model lacks, or misspelt, is lost on the way.
CHECK = """
import json, sys, yaml
from kubernetes import client
api = client.ApiClient()
class Answer:
    def __init__(self, data): self.data = json.dumps(data)
models = {("v1", "Service"): "V1Service", ("apps/v1", "StatefulSet"): "V1StatefulSet", ("apps/v1", "Deployment"): "V1Deployment"}
kinds = []
for given in yaml.safe_load_all(sys.stdin):
    model = models[given["apiVersion"], given["kind"]]
    again = api.sanitize_for_serialization(api.deserialize(Answer(given), model))
    if again != given:
        sys.exit(f"{given['kind']}: {json.dumps(given)} becomes {json.dumps(again)}")
    kinds.append(given["kind"])
print(*kinds)
"""


def python_with_kubernetes():
    for python in (sys.executable, "/usr/bin/python3"):
        if subprocess.run([python, "-c", "import kubernetes, yaml"], capture_output=True).returncode == 0:
            return python
    return None


@unittest.skipUnless(python_with_kubernetes(), "python3-kubernetes is not installed (deploy/install --tests installs it)")
class Manifests(Case):
    def check(self, text):
        return subprocess.run([python_with_kubernetes(), "-c", CHECK], input=text, capture_output=True, text=True)

    def test_every_field_is_known(self):
        done = self.check(MANIFEST.read_text())
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stdout.split(), ["Service", "StatefulSet", "Deployment"])

    def test_a_field_that_is_misspelt_is_found(self):
        text = MANIFEST.read_text()
        for right, wrong in (("readOnlyRootFilesystem", "readOnlyRootFileSystem"), ("replicas: 3", "replica: 3"), ("containerPort", "port")):
            self.assertIn(right, text)
            self.assertNotEqual(self.check(text.replace(right, wrong)).returncode, 0, wrong)


if __name__ == "__main__":
    main()
