"""`hilbertvae-train` with settings of a training that another one makes idle."""

import pytest
from composed_settings import key_of, settings_of
from warm_start import train

from hilbertvae.checks import InputError
from hilbertvae.commands.overrides import refuse_idle


@pytest.mark.parametrize(("words", "makes_idle", "why"), [
    (["likelihood.vote_power=0.5", "likelihood.observed_weight=1", "likelihood={masked: false}"], ["likelihood.kind=gaussian"],
     "likelihood.kind=gaussian, to which all cells count alike"),
    (["trainer.kl_weight=0.5", "trainer={free_nats: 0}", "++trainer.kl_warmup_share=0.3"], ["network.variational=false"],
     "network.variational=false, which pays no KL"),
    (["likelihood.known_weight=1"], ["network.known=false"], "network.known=false"),
    (["likelihood.known_weight=1"], ["network=paper_32", "grid.cells=32"], "network.kind=paper, which does not say what would be known"),
    (["augmentation.count_factor=2"], ["network.encoding=hit_free"], "network.encoding=hit_free, which shows no counts"),
    (["augmentation.count_factor=2"], ["network=paper_32", "grid.cells=32"], "network.encoding=signed, which shows no counts"),
])  # fmt: skip
def test_settings_that_another_one_makes_idle_are_not_typed(words, makes_idle, why):
    """Those of an experiment may be."""
    for word in words:
        with pytest.raises(InputError, match=f"^{key_of(word)}: expected none with {why}$"):
            refuse_idle(settings_of(*makes_idle), ["name=again", word])
        refuse_idle(settings_of(), ["name=again", word])
        refuse_idle(settings_of(*makes_idle, word), ["name=again", "experiment=faithful"])


@pytest.mark.parametrize(("many", "said"), [
    ([], "trainer.kl_weight: expected none with network.variational=false"),
    (["-m"], "trainer.initial: 3d-sim is a network of 3D"),  # which would be refused in any case
])  # fmt: skip
def test_jobs_of_a_multirun_may_make_idle_what_others_use(tmp_path, many, said):
    words = ["network.variational=false", "trainer.kl_weight=0.5", "trainer.initial=3d-sim", "debug=fast"]
    done = train(tmp_path, *many, *words)
    assert done.returncode and said in done.stderr
