const form = document.getElementById("login");
const answer = document.getElementById("answer");
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const fields = new FormData(form);
  const response = await fetch("/api/login", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ name: fields.get("name"), password: fields.get("password") }),
  });
  if (response.ok) location.assign("/");
  else answer.textContent = (await response.json()).text;
});
