"""How well the arm is identified: experiments on noise, load and friction."""
