"""`python -m hilbertvae.train` is `hilbertvae-train`."""

from hilbertvae.commands.train import main

if __name__ == "__main__":
    main()
